"""The notebook-like example as a script, on a flight whose truth is exact."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from flights import EXAMPLES

from motion_detect_ros.__main__ import main
from motion_detect_ros.cli.demo import FLIGHT_BAG, record_flight
from motion_detect_ros.sources.synthetic import FlightConfig

FPS, FRAMES, SPEED_PX, CAMERA_PX = 20, 24, 5, 3
#: A square of 36 px that moves 5 px a frame to the right over ground that moves 3 px a frame down.
FLIGHT = dataclasses.replace(
    FlightConfig.single(36, SPEED_PX, CAMERA_PX, frames=FRAMES), width=320, height=240, fps=float(FPS))


def test_from_bag_to_plots(tmp_path: Path) -> None:
    for name in ('pandas', 'plotly'):
        pytest.importorskip(name, reason=f'pip install {name}')
    import pandas as pd

    truth = record_flight(FLIGHT, tmp_path)
    out = tmp_path / 'out'
    done = subprocess.run([sys.executable, EXAMPLES / 'analyse_flight.py', tmp_path / FLIGHT_BAG, out],
                          capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == str(out / 'flight.html')
    objects = pd.read_csv(out / 'objects.csv')
    assert len(objects) == 1 == len(set(truth['id'].tolist()))
    (thing,) = objects.itertuples()
    assert thing.speed_px_s == pytest.approx(SPEED_PX * FPS, rel=0.05)
    assert thing.width_px == pytest.approx(np.median(truth['w']), abs=6)
    assert thing.frames > FRAMES / 2
    page = (out / 'flight.html').read_text(encoding='utf-8')
    assert page.count('Plotly.newPlot(') == 4
    assert 'src="http' not in page, 'it needs no network'


def test_results_of_something_else_stay(tmp_path: Path) -> None:
    for name in ('pandas', 'plotly'):
        pytest.importorskip(name, reason=f'pip install {name}')
    record_flight(dataclasses.replace(FLIGHT, frames=8), tmp_path)
    out = tmp_path / 'out'
    assert main(['replay', str(tmp_path / FLIGHT_BAG), '-o', str(out), '--no-report', '--preset', 'visdrone']) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    done = subprocess.run([sys.executable, EXAMPLES / 'analyse_flight.py', tmp_path / FLIGHT_BAG, out],
                          capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stdout) == (2, '')
    assert done.stderr.startswith(f'error: {out}: holds a result of something else (')
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize('words', [[], ['flight.mcap'], ['flight.mcap', 'out', 'visdrone']])
def test_takes_an_input_and_a_folder(words: list[str]) -> None:
    for name in ('pandas', 'plotly'):
        pytest.importorskip(name, reason=f'pip install {name}')
    done = subprocess.run([sys.executable, EXAMPLES / 'analyse_flight.py', *words],
                          capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (
        2, '', f'analyse_flight: expected an input and a folder for the results, got {len(words)} arguments\n')


def test_its_cells_are_those_of_a_notebook() -> None:
    text = (EXAMPLES / 'analyse_flight.py').read_text(encoding='utf-8')
    cells = [line for line in text.splitlines() if line.startswith('# %%')]
    assert text.startswith('# %% [markdown]\n')
    assert set(cells) == {'# %%', '# %% [markdown]'} and len(cells) >= 10
