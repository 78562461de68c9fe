"""Credentials of addresses: masked where they are shown, put in where they are used."""

from __future__ import annotations

from pathlib import Path

import pytest

from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.sources.secrets import SECRET_VARIABLE, masked, with_secret


@pytest.mark.parametrize(('shown', 'address'), [
    ('rtsp://***@10.0.0.2:554/live', 'rtsp://admin:s3cret@10.0.0.2:554/live'),
    ('rtsp://***@cam/live', 'rtsp://admin:p@ss/w:rd@cam/live'),
    ('http://***@cam', 'http://token@cam'),
    ('http://cam/mjpg?user=***&PassWord=***&fps=5', 'http://cam/mjpg?user=***&PassWord=s3cret&fps=5'),
    ('https://cam/v?access_token=***', 'https://cam/v?access_token=s3cret'),
    ('rtsp:/***@cam', 'rtsp:/admin:s3cret@cam'),
    ('a rtsp://***@x/1 and http://***@y: gone', 'a rtsp://a:b@x/1 and http://c:d@y: gone'),
    ('rtsp://***@cam/live: gone', 'rtsp://admin:my s3cret@cam/live: gone'),
    ('rtsp://cam:554/user=admin_password=***', 'rtsp://cam:554/user=admin_password=s3cret_channel=1_stream=0.sdp?real'),
    ('http://cam/video.cgi?loginuse=a&loginpas=***', 'http://cam/video.cgi?loginuse=a&loginpas=s3cret'),
    ('rtsp://cam:554/live', 'rtsp://cam:554/live'),
    ('/home/me/a@b/clip.mp4', '/home/me/a@b/clip.mp4'),
    ('0', '0'),
])
def test_what_is_shown_of_an_address(shown: str, address: str):
    assert masked(address) == shown
    assert masked(shown) == shown


@pytest.mark.parametrize(('secret', 'address', 'expected'), [
    ('me:p@ss/w', 'rtsp://cam/live', 'rtsp://me:p%40ss%2Fw@cam/live'),
    ('me:new\n', 'rtsp://old:pw@cam/live', 'rtsp://me:new@cam/live'),
    ('rtsp://me:pw@cam/live', 'rtsp://other/live', 'rtsp://me:pw@cam/live'),
    ('me:pw', 'rtsp://cam/live?mail=me@example.org', 'rtsp://me:pw@cam/live?mail=me@example.org'),
    ('me:pw', 'rtsp://cam:554/a@b/live', 'rtsp://me:pw@cam:554/a@b/live'),
    ('me:pw', 'http://old:o@ld@[fe80::1]:80/a@b?c@d', 'http://me:pw@[fe80::1]:80/a@b?c@d'),
    ('me:pw', 'http://cam?a@b', 'http://me:pw@cam?a@b'),
    ('me:pw', 'http://cam#a@b', 'http://me:pw@cam#a@b'),
])
def test_credentials_from_file_and_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, secret: str, address: str, expected: str,
):
    file = tmp_path / 'secret'
    file.write_text(secret)
    assert with_secret(address, str(file)) == expected
    assert with_secret(address, '') == address
    monkeypatch.setenv(SECRET_VARIABLE, secret)
    assert with_secret(address, '') == expected


@pytest.mark.parametrize('secret', ['me:pw', 'rtsp://me:pw@cam/live'])
@pytest.mark.parametrize('source', ['0', '/dev/video0', 'flight.mp4', 'file:///data/flight.mp4'])
def test_the_environment_is_for_addresses_only(monkeypatch: pytest.MonkeyPatch, source: str, secret: str):
    monkeypatch.setenv(SECRET_VARIABLE, secret)
    assert with_secret(source, '') == source


def test_a_file_may_hold_the_address_of_what_has_none(tmp_path: Path):
    (tmp_path / 'secret').write_text('rtsp://me:pw@cam/live')
    assert with_secret('0', str(tmp_path / 'secret')) == 'rtsp://me:pw@cam/live'


@pytest.mark.parametrize('address', ['rtsp://old:p/w@cam/live', 'rtsp://old:7x?@cam', 'rtsp://cam:99999/', 'rtsp://[::1/'])
def test_credentials_go_nowhere_where_the_host_is_not_clear(monkeypatch: pytest.MonkeyPatch, address: str):
    monkeypatch.setenv(SECRET_VARIABLE, 'me:pw')
    with pytest.raises(SourceError) as caught:
        with_secret(address, '')
    assert str(caught.value) == (f'source: expected HOST or HOST:PORT after ://, got {masked(address)}; '
                                 'a / in a password is written %2F, a ? %3F, a # %23')


def test_files_without_credentials_are_refused(tmp_path: Path):
    for name, content in (('empty', b''), ('two', b'a\nb'), ('binary', b'\xff\xfe')):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(SourceError, match=f'source_secret_file .*{name}: '):
            with_secret('rtsp://cam', str(tmp_path / name))
    with pytest.raises(SourceError, match='No such file'):
        with_secret('rtsp://cam', str(tmp_path / 'no'))
    (tmp_path / 'good').write_text('a:b')
    for source in ('/dev/video0', '0', 'file:///data/flight.mp4'):
        with pytest.raises(SourceError, match='expected an address'):
            with_secret(source, str(tmp_path / 'good'))
