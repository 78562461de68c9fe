# %% [markdown]
# # A flight, from the bag to plots
#
# A notebook in the percent format: open it in VS Code, Spyder or PyCharm, or with `jupytext --to ipynb`, and run it
# cell by cell; or run it whole as a script, without ROS:
#
#     pip install jinja2 plotly av pandas
#     python3 analyse_flight.py flight.mcap out
#
# `replay` writes tables, pandas reads them: `detections.csv` (a row an object and frame), `frames.csv` (a row a frame:
# status and ego-motion) and `times.csv` (milliseconds of every stage). The results are `out/flight.html`, one page that
# needs no network, and `out/objects.csv`.

# %%
import json
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import plotly.express as px

from motion_detect_ros.__main__ import main

# In a notebook, put your own paths instead of these lines. An input is what `replay` takes: bag, video, image folder.
if len(sys.argv) != 3:
    print(f'analyse_flight: expected an input and a folder for the results, got {len(sys.argv) - 1} arguments',
          file=sys.stderr)
    sys.exit(2)
bag, out = Path(sys.argv[1]), Path(sys.argv[2])

# %% [markdown]
# ## Detect
# Every frame, the same answer every time; `--preset` says what kind of scene it is. What an earlier run has left of the
# same is taken as it is, of anything else it stays, and this ends.

# %%
code = main(['replay', str(bag), '-o', str(out), '--preset', 'default'])
if code not in {0, 3}:  # 3: the bag is damaged; what could be read is there
    raise SystemExit(code)
if not (out / 'detections.csv').is_file():
    print(f'analyse_flight: expected one recording in {bag}, got a folder of them', file=sys.stderr)
    sys.exit(2)
detections = pd.read_csv(out / 'detections.csv')
frames = pd.read_csv(out / 'frames.csv')
times = pd.read_csv(out / 'times.csv')
summary = json.loads((out / 'summary.json').read_text(encoding='utf-8'))
width, height = summary['image_size']

# %% [markdown]
# ## Objects
# One row each: how long it was seen, how fast it was (pixels a second, the camera's motion removed), how sure.

# %%
begin_ns = frames['stamp_ns'].min()
detections['time_s'] = (detections['stamp_ns'] - begin_ns) / 1e9
detections['speed_px_s'] = np.hypot(detections['vel_u'], detections['vel_v'])
objects = detections.groupby('id').agg(
    first_s=('time_s', 'min'), last_s=('time_s', 'max'), frames=('frame', 'count'),
    speed_px_s=('speed_px_s', 'median'), width_px=('w', 'median'), height_px=('h', 'median'),
    score=('score', 'median')).reset_index().sort_values('frames', ascending=False)
objects.to_csv(out / 'objects.csv', index=False)
print(objects.to_string(index=False))

# %% [markdown]
# ## Where they went over the ground
# Each row of `frames.csv` maps the frame before to this one. Chained and inverted, the maps bring every box centre into
# the first frame: what the camera did is gone, and what is left is what the objects did. (On flat ground, that is; and
# errors add up, so do not do that over minutes.)

# %%
to_first, maps = {}, np.eye(3)
for row in frames.itertuples():
    step = np.array([[row.m00, row.m01, row.m02], [row.m10, row.m11, row.m12], [0.0, 0.0, 1.0]])
    maps = (step if np.isfinite(step).all() else np.eye(3)) @ maps
    to_first[row.frame] = np.linalg.inv(maps)
centres = np.stack([detections['x'] + detections['w'] / 2, detections['y'] + detections['h'] / 2,
                    np.ones(len(detections))], axis=-1)
ground = np.array([to_first[frame] @ centre for frame, centre in zip(detections['frame'], centres, strict=True)])
detections[['ground_x', 'ground_y']] = ground.reshape(-1, 3)[:, :2]
detections['object'] = detections['id'].astype(str)

# %% [markdown]
# ## Plots

# %%
paths = px.line(detections, 'ground_x', 'ground_y', color='object', markers=True, hover_data=['frame', 'speed_px_s'],
                title='Paths, in pixels of the first frame')
paths.update_yaxes(autorange='reversed', scaleanchor='x')
paths.add_shape(type='rect', x0=0, y0=0, x1=width, y1=height, line_color='grey')
speeds = px.line(detections, 'time_s', 'speed_px_s', color='object', title='Speed, pixels a second')
counts = px.bar(frames.assign(time_s=(frames['stamp_ns'] - begin_ns) / 1e9), 'time_s', 'detections', color='ego_status',
                title='Objects a frame, by the status of the ego-motion')
stages = px.box(times.melt('frame', var_name='stage', value_name='ms'), 'stage', 'ms', log_y=True,
                title='Time of every stage, ms a frame')

# %%
figures = [figure.to_html(full_html=False, include_plotlyjs=number == 0)
           for number, figure in enumerate((paths, speeds, counts, stages))]
page = out / 'flight.html'
page.write_text('<!doctype html><meta charset="utf-8"><title>Flight</title>\n' + '\n'.join(figures), encoding='utf-8')
print(page)
