"""Reports in a browser, from file://: they play, seek, sort, and ask for nothing from elsewhere."""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import results_by_hand
from results_by_hand import BIT_CENTRES, FRAMES, OBJECTS, number_of, write_pictures, write_results, write_truth

from motion_detect_ros.__main__ import main

for _library in ('av', 'jinja2', 'plotly'):
    pytest.importorskip(_library, reason=f'{_library} is not installed (extra "report")')
webdriver = pytest.importorskip('selenium.webdriver', reason='selenium is not installed (extra "test")')

#: The name of an input as nobody would choose it who means well.
HOSTILE = "<img src=x onerror=document.title='owned'>\"'&{{7*7}}"
#: Starting a browser on a machine with other work, s.
PATIENCE_S = 180


@pytest.fixture(scope='module')
def browser() -> Iterator[Any]:
    chromium = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), None)
    driver = shutil.which('chromedriver')
    if not chromium or not driver:
        pytest.skip('no Chromium with chromedriver: apt install chromium chromium-driver')
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for word in ('--headless=new', '--no-sandbox', '--disable-dev-shm-usage', '--disable-gpu', '--mute-audio',
                 '--window-size=1400,900'):
        options.add_argument(word)
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL', 'performance': 'ALL'})
    session = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    session.set_page_load_timeout(PATIENCE_S)
    session.set_script_timeout(PATIENCE_S)
    try:
        yield session
    finally:
        session.quit()


@pytest.fixture(scope='module')
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report with everything in it, of an input with a hostile name."""
    folder = tmp_path_factory.mktemp('report')
    source = write_pictures(folder / HOSTILE)
    results = write_results(folder / 'out', str(source), damaged=f'cut at {HOSTILE}')
    assert main(['report', str(results), '--truth', str(write_truth(folder / 'truth.csv'))]) == 0
    return results / 'report.html'


def until(browser: Any, script: str) -> Any:
    """What a script gives, as soon as that is true."""
    end = time.monotonic() + PATIENCE_S
    while not (found := browser.execute_script(f'return {script}')):
        assert time.monotonic() < end, f'waited for {script}: {browser.get_log("browser")}'
        time.sleep(0.05)
    return found


def open_page(browser: Any, page: Path) -> None:
    """Open it and wait until everything is there."""
    browser.get_log('browser'), browser.get_log('performance')
    browser.get(page.absolute().as_uri())
    until(browser, "document.body.dataset.ready === 'yes'")


def requested(browser: Any) -> list[str]:
    """Every address that the browser has asked for since the page was opened."""
    messages = [json.loads(entry['message'])['message'] for entry in browser.get_log('performance')]
    return [message['params']['request']['url'] for message in messages
            if message['method'] == 'Network.requestWillBeSent']


#: Grey levels of the picture that the film shows at ``BIT_CENTRES``, once it has come to rest.
SHOWN = f'''(() => {{
  const video = document.getElementById('video'), canvas = document.createElement('canvas');
  if (video.seeking || video.readyState < 2) return null;
  [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
  const pen = canvas.getContext('2d', {{willReadFrequently: true}});
  pen.drawImage(video, 0, 0);
  return {json.dumps(BIT_CENTRES)}.map(([x, y]) => pen.getImageData(x, y, 1, 1).data[1]);
}})()'''


def frame_shown(browser: Any, wanted: int) -> int:
    """The frame of the input that the film shows, as its picture says; waits for the ``wanted`` one for a while."""
    end, frame = time.monotonic() + PATIENCE_S, -1
    while frame != wanted and time.monotonic() < end:
        frame = number_of(until(browser, SHOWN))
        time.sleep(0.05)
    return frame


def ids_listed(browser: Any) -> list[int]:
    return browser.execute_script(
        "return [...document.querySelectorAll('#objects tbody tr')].map(row => Number(row.dataset.object))")


def test_time_of_a_frame_stands_beside_the_time_until_the_next_one(report: Path):
    """How fast the replay was it does not say: six frames were in work at once."""
    text = report.read_text(encoding='utf-8')
    assert '<b>14 ms</b><span>of processor time a frame, the next one comes after 100 ms</span>' in text
    assert 'real time' not in text


def test_page_plays_seeks_and_sorts_without_network(browser: Any, report: Path):
    open_page(browser, report)
    assert browser.find_element('tag name', 'h1').text == HOSTILE
    assert browser.title.startswith(HOSTILE)
    assert f'The input is damaged: cut at {HOSTILE}' in browser.find_element('css selector', '.note').text
    assert until(browser, "document.getElementById('video').duration") == pytest.approx(FRAMES / 10, abs=0.11)
    assert frame_shown(browser, 0) == 0

    bars = browser.find_elements('css selector', '#timeline .barlayer .point')
    assert len(bars) == len(OBJECTS)
    browser.execute_script('arguments[0].scrollIntoView({block: "center", behavior: "instant"})', bars[1])
    webdriver.ActionChains(browser).move_to_element(bars[1]).pause(0.3).click().perform()
    middle = OBJECTS[12][0].start + len(OBJECTS[12][0]) // 2
    until(browser, "document.querySelector('tr.chosen')")
    seconds = until(browser, "document.getElementById('video').currentTime")
    assert seconds == pytest.approx(middle / 10, abs=0.25)
    assert frame_shown(browser, int(10 * seconds)) == int(10 * seconds)
    assert browser.find_element('css selector', 'tr.chosen').get_attribute('data-object') == '12'

    browser.find_element('css selector', 'tr[data-object="3"]').click()
    assert frame_shown(browser, OBJECTS[3][0].start) == OBJECTS[3][0].start
    browser.find_element('id', 'ahead').click()
    assert frame_shown(browser, OBJECTS[3][0].start + 1) == OBJECTS[3][0].start + 1
    missed = browser.find_element('css selector', 'figure[data-seconds]')
    browser.execute_script('arguments[0].click()', missed)
    assert frame_shown(browser, round(10 * float(missed.get_attribute('data-seconds')))) != OBJECTS[3][0].start + 1

    assert ids_listed(browser) == [7, 12, 3]
    headers = browser.find_elements('css selector', '#objects th button')
    for header, expected in ((0, [3, 7, 12]), (0, [12, 7, 3]), (2, [12, 7, 3]), (2, [3, 7, 12]), (6, [7, 3, 12])):
        browser.execute_script('arguments[0].click()', headers[header])
        found = ids_listed(browser)
        assert found == expected or (header == 6 and found[0] == 7), 'by contact: unknown ones are last'

    browser.execute_script("document.getElementById('play').click()")
    until(browser, "document.getElementById('video').ended")
    assert browser.execute_script("return document.getElementById('now').textContent") == '3.90 s · frame 39'

    assert browser.title.startswith(HOSTILE), 'nothing of the name was run'
    assert [entry for entry in browser.get_log('browser') if entry['level'] in ('SEVERE', 'WARNING')] == []
    asked = requested(browser)
    assert asked[0] == report.absolute().as_uri()
    assert [url for url in asked[1:] if not url.startswith(('data:', 'blob:null/'))] == []


def test_policy_of_the_page_forbids_what_comes_from_elsewhere(browser: Any, report: Path):
    """Whatever should get into the page: neither a picture from an address nor a script of its own."""
    open_page(browser, report)
    refused = browser.execute_async_script('''
        const done = arguments[arguments.length - 1], refused = [];
        document.addEventListener('securitypolicyviolation', event => {
          refused.push(event.effectiveDirective);
          if (refused.length === 2) done(refused);
        });
        new Image().src = 'http://127.0.0.1:9/x.png';
        const script = document.createElement('script');
        script.textContent = 'document.title = "owned"';
        document.head.append(script);''')
    assert sorted(refused) == ['img-src', 'script-src-elem']
    assert browser.title != 'owned'


def test_colours_of_the_timeline(browser: Any, report: Path):
    open_page(browser, report)
    browser.execute_script("""const choice = document.getElementById('color-by'); choice.value = 'score';
        choice.dispatchEvent(new Event('change'))""")
    colors = until(browser, "document.getElementById('timeline').data[0].marker.colorscale && "
                            "document.getElementById('timeline').data[0].marker.color")
    assert colors == pytest.approx([0.87, 0.92, 0.83]), 'scores 0.87, 0.92 and 0.83 of objects 7, 12 and 3'


def test_nothing_found_no_truth_and_input_gone(browser: Any, tmp_path: Path):
    results = write_results(tmp_path / 'out', str(tmp_path / 'gone.mp4'), {}, complete=False)
    assert main(['report', str(results), '-o', str(tmp_path / 'page.html')]) == 0
    open_page(browser, tmp_path / 'page.html')
    text = browser.find_element('tag name', 'body').text
    assert f'No pictures here, as the input could not be read again: {tmp_path}/gone.mp4: no such file' in text
    assert 'The replay was interrupted' in text
    assert f'No moving object was found in {FRAMES} frames.' in text
    assert 'Against truth' not in text
    assert browser.find_elements('css selector', '#ego .scatterlayer .trace')
    assert browser.find_elements('css selector', 'video, #timeline, #heat') == []
    assert [entry for entry in browser.get_log('browser') if entry['level'] in ('SEVERE', 'WARNING')] == []


def test_index_links_reports_and_sorts(browser: Any, report: Path, tmp_path: Path):
    odd = tmp_path / 'out' / f'a {HOSTILE}'
    shutil.copytree(report.parent, odd)
    write_results(tmp_path / 'out' / 'b', 'flight.mcap', {7: range(5, 9)})
    (tmp_path / 'out' / 'c').mkdir()
    (tmp_path / 'out' / 'c' / 'summary.json').write_text('{}')
    assert main(['report', 'index', str(tmp_path / 'out')]) == 0
    browser.get((tmp_path / 'out' / 'index.html').as_uri())
    rows = [row.text for row in browser.find_elements('css selector', '#replays tbody tr')]
    assert [row[0] for row in rows] == ['a', 'b', 'c']
    assert '(no report)' in rows[1]
    assert 'expected the summary of a replay' in rows[2]
    browser.find_elements('css selector', '#replays th button')[4].click()
    order = [row.text[0] for row in browser.find_elements('css selector', '#replays tbody tr')]
    assert order == ['a', 'b', 'c'], 'three objects, one, unknown'
    browser.find_element('css selector', '#replays a').click()
    until(browser, "document.body.dataset.ready === 'yes'")
    assert browser.find_element('tag name', 'h1').text == HOSTILE


def test_page_is_the_same_for_the_same_results(report: Path, tmp_path: Path):
    first = report.read_bytes()
    assert main(['report', str(report.parent), '--truth', str(report.parent.parent / 'truth.csv'),
                 '-o', str(tmp_path / 'again.html')]) == 0
    assert (tmp_path / 'again.html').read_bytes() == first
    assert len(first) < 3_500_000


def test_a_replay_of_the_first_frames_only_has_no_score(tmp_path: Path):
    results = write_results(tmp_path / 'out', str(tmp_path / 'gone.mp4'), source_frames=10)
    for name in ('frames.csv', 'times.csv', 'detections.csv'):
        header, *rows = (results / name).read_text().splitlines()
        (results / name).write_text('\n'.join([header, *(row for row in rows if int(row.split(',')[0]) < 10), '']))
    assert main(['report', str(results), '--truth', str(write_truth(tmp_path / 'truth.csv'))]) == 0
    page = (results / 'report.html').read_text(encoding='utf-8')
    assert 'No frame is counted: the first 10 never are' in page
    assert 'F1 (precision' not in page


def test_another_recording_is_not_taken_for_the_replayed_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    pictures, other = tmp_path / 'pictures', tmp_path / 'other'
    write_pictures(pictures)
    write_pictures(other)
    (other / 'more.txt').write_text('one byte more is another recording')
    size = sum(each.stat().st_size for each in pictures.iterdir())
    results = write_results(tmp_path / 'out', str(tmp_path / 'gone'), input_bytes=size)
    assert main(['report', str(results), '--input', str(other)]) == 2
    line = capsys.readouterr().err
    assert line.startswith(f'error: --input: expected the recording that was replayed, {size} bytes, got {other}, ')
    assert main(['report', str(results), '--input', str(tmp_path / 'nowhere')]) == 2
    assert capsys.readouterr().err == f'error: --input: {tmp_path}/nowhere: no such file or folder\n'
    assert main(['report', str(results), '--input', str(pictures)]) == 0


def test_a_page_that_cannot_be_written_is_named_as_it_was_given(
    report: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    assert main(['report', str(report.parent), '-o', str(tmp_path / 'no' / 'x.html')]) == 2
    assert capsys.readouterr().err == f'error: {tmp_path}/no/x.html: No such file or directory\n'


def test_replay_of_nothing(tmp_path: Path):
    results = write_results(tmp_path / 'out', str(tmp_path / 'gone.mp4'), {}, frames=0)
    for name in ('frames.csv', 'times.csv'):
        (results / name).write_text((results / name).read_text().splitlines()[0] + '\n')
    assert main(['report', str(results)]) == 0
    page = (results / 'report.html').read_text(encoding='utf-8')
    assert 'No frame was processed.' in page
    assert 'could not be read' not in page


@pytest.mark.parametrize(('words', 'said'), [
    (['{}/nowhere'], 'expected the folder of a replay'),
    (['index', '{}'], 'expected folders of replays, found no summary.json in or below it'),
    (['one', 'two'], 'expected DIR or index DIR, got one two'),
    (['index', '{}', '--truth', 'x.csv'], 'expected neither --truth nor --input'),
    (['{}', '--truth', '{}/none.csv'], 'summary.json: expected the summary of a replay'),
])
def test_wrong_use_is_one_line(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
):
    assert main(['report', *(word.format(tmp_path) for word in words)]) == 2
    line = capsys.readouterr().err
    assert said in line
    assert line.count('\n') == 1


def test_missing_library_is_named(report: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setitem(sys.modules, 'plotly', None)
    before = report.read_bytes()
    assert main(['report', str(report.parent)]) == 2
    assert capsys.readouterr().err == 'error: expected plotly, not installed: pip install plotly\n'
    assert report.read_bytes() == before


def test_a_moment_is_shown_with_its_own_picture_at_any_rate(
    browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At 30 frames/s frame 20 is at 0.6667 s, a little later than it really is."""
    monkeypatch.setattr(results_by_hand, 'FPS', 30.0)
    results = write_results(tmp_path / 'out', str(write_pictures(tmp_path / 'pictures')), fps=30.0)
    assert main(['report', str(results)]) == 0
    open_page(browser, results / 'report.html')
    row = browser.find_element('css selector', 'tr[data-object="3"]')
    assert float(row.get_attribute('data-seconds')) == pytest.approx(OBJECTS[3][0].start / 30)
    row.click()
    assert frame_shown(browser, OBJECTS[3][0].start) == OBJECTS[3][0].start
