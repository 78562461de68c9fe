"""Outputs that the user has not named: a shell variable that is not set."""

from __future__ import annotations

from pathlib import Path

import pytest

from motion_detect_ros.__main__ import main


@pytest.mark.parametrize('words', [
    ['replay', 'in'], ['demo'], ['tune', 'in'], ['report', 'in'], ['convert', 'images', 'in'],
    ['evaluate', 'in', '--truth', 'a.csv', '--worst', '3'],
], ids=lambda words: words[0])
@pytest.mark.parametrize('name', ['', ' '])
def test_an_empty_name_is_not_this_folder(
    words: list[str], name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main([*words, '-o', name])
    assert ended.value.code == 2
    assert f'argument -o/--output: expected a name, got {name!r}' in capsys.readouterr().err
    assert not [*tmp_path.iterdir()]
