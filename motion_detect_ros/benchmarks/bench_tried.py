"""``bench``: what was tried to make it faster, and what came of it; text of docs/performance.md."""

#: Written by hand: trials are not part of a run.
TRIED = '''## What was aimed at

Goals for two cores on real clips, where they stand, and what is in the way; figures of the tables above and below. The
tables above are from before errors were computed once a frame and threads began on another processor (below); the
section after this one compares with the first version on another, slower machine.

| goal | stands at | in the way |
|---|---|---|
| frame to answer 22, 25, 25 ms (305, `uavdt_M1303`, KITTI) | 12, 15, 23 ms | reached |
| its 95th percentile 1.2 times the median | 1.14 to 1.22, 1.08 to 1.22, 1.19 to 1.24 in four runs since threads begin \
on another processor; 1.26, 1.22, 1.15 in the tables above, 1.25 to 1.27, 1.25 to 1.27, 1.20 in the hour of the change \
| reached in two, three and two of them |
| processor time 38, 44, 44 ms, of 57, 67, 68 ms in the first version | 38, 44, 30 ms; 0.74, 0.75, 0.51 times what \
the first version takes, 0.67, 0.66, 0.65 being the goal | reached, on the slower machine on KITTI only: the first \
version had no points |
| clustering stage 7, 8, 8 ms, of 19, 22, 18 ms in the first version | 0.39, 0.32, 0.44 times what the first version \
takes, 0.37, 0.36, 0.44 being the goal | reached but on 305, where half of it is OpenCV's tracker: 7700 points \
forwards and back in every frame |
| one thread on 305 42 ms | 35 ms | reached |
| faster than both plain methods | 12, 15, 23 ms; 28, 30, 26 and 21, 24, 24 ms | reached, on KITTI by a little; in \
processor time faster than the difference everywhere, than KLT + DBSCAN on KITTI only |
| 100 objects 1.3 times as dear as none (default, 1600x900) | 1.6 times: 46, 74 ms on the slower machine, 1.7 with \
weak candidates too (below; the table above: 2.0) | errors and photometric test take 8 ms, patches 6, tracks 4, growth \
2, all of it once for each object; the flow is the same |
| `replay` 1.6 times as fast by overlapping its steps | 1.3 times on 305 and `uavdt_M1303`, 1.4 on KITTI, beside one \
frame after the other (1.1 to 1.3 before; below); 1.5, 1.5 and 2.0 times as fast as `replay` of the first version \
(medians of 6 to 8 runs in turn in two hours, 1.2 to 2.6) | 1.6 would be two cores without a gap: they are busy for \
0.62 of the time one frame after the other, for 0.81 to 0.88 now; in the rest steps wait for Python's lock, which is \
held for 0.61 of the time (305) |
| first start after an installation 6 s | 1.8 to 1.9 s after `colcon build`, which compiles the kernels (below); where \
it has not, as after `pip install`, 8.0 s in this run, 6.3 to 6.6 s in others on a quiet machine, 11 s beside others, \
10.1 to 10.3 s on the slower machine | reached with `colcon build`; without it 60 kernels take over 20 s of processor \
time of numba, and up to 2 s are Fast DDS's discovery; `selftest` compiles them, too |
| `pipeline` at most 350 MB, first start included | 305 to 343 MB | reached with the preset `default`; `visdrone` 380 \
MB after half an hour |

## The first version, and this one

The version with which these goals were set, of 21 November 2026, and this one, each clip forwards and backwards by a
process of its own, one after the other in one hour, two runs of each, ms; by a script, not by `bench`. Another machine
than that of the tables above (2 cores of an Intel Xeon): the first version took 36, 44 and 43 ms on the machine of the
goals. It tracked no points for small objects; its threads were OpenCV's, those of this one are its own two.

| clip | | median | p95 | p95 / median | clustering stage, median | until ready, mean | processor, mean |
|---|---|---|---|---|---|---|---|
| 305 | first version | 42.3, 42.4 | 45.7, 44.6 | 1.08, 1.05 | 22.0, 21.8 | 42.5, 42.4 | 61.6, 61.9 |
| | now | 13.7, 13.9 | 15.9, 15.9 | 1.16, 1.14 | 8.4, 8.6 | 36.4, 37.0 | 45.6, 46.3 |
| 339 | first version | 44.7, 44.9 | 59.8, 60.2 | 1.34, 1.34 | 24.6, 24.9 | 45.8, 46.5 | 67.1, 68.2 |
| | now | 10.7, 10.6 | 12.5, 12.2 | 1.17, 1.15 | 5.7, 5.6 | 30.2, 30.0 | 37.8, 37.5 |
| `uavdt_M1303` | first version | 49.2, 48.2 | 52.8, 51.1 | 1.07, 1.06 | 27.2, 26.9 | 49.3, 48.0 | 70.9, 69.0 |
| | now | 16.2, 15.8 | 19.7, 17.0 | 1.22, 1.08 | 8.8, 8.5 | 43.7, 42.8 | 53.3, 52.2 |
| KITTI | first version | 45.9, 44.0 | 52.1, 49.1 | 1.14, 1.12 | 23.7, 22.7 | 45.9, 43.7 | 69.3, 66.2 |
| | now | 26.1, 25.2 | 31.1, 30.2 | 1.19, 1.20 | 10.4, 9.9 | 27.8, 26.8 | 35.3, 34.1 |

## What pays, and what does not

Measured when it was built or tried, on the clips named; accuracy that it costs or gains: [accuracy.md](accuracy.md).

| pays | before | after |
|---|---|---|
| forward-backward check of the flow on its grid instead of every pixel (nine clips, frame) | 69 ms | 42 ms |
| points: change at half the resolution, new ones in every second frame, fewer baselines (one thread, points only) | \
82 ms | 42 ms |
| points: motion and clusters every 0.1 s (the same) | 42 ms | 21 ms |
| flow every 0.1 s, in other frames than these (305, processor time of a frame) | 77 ms | 45 ms |
| objects of points and of flow looked for behind the answer, for the next frame, where frames take up to 0.06 s \
(frame to answer on two cores, mean; two or three runs each in one hour, with the next two lines: 305, `uavdt_M1303`) \
| 60 to 78, 60 ms | 17 to 21, 19 to 24 ms |
| kernels in place of NumPy calls on small arrays (one thread, a frame of 305: motion of the points and which of them \
can be spared 6.2 to 1.7, clusters 4.4 to 1.9, boxes of points 7.7 to 3.3, candidates of flow 4.7 to 3.3, tracks 1.8 \
to 0.9, ART2 1.0 to 0.15 ms; corners of new points in the cells that need one only 7.6 to 3.2 ms; all together) | 58 \
to 63 ms | 41 to 47 ms |
| up to two threads, the package's own instead of OpenCV's, which wait for their next call in a loop (processor time \
of 305, `uavdt_M1303`, KITTI; the frame as long) | 52 to 56, 62 to 65, 61 to 66 ms | 45 to 57, 48 to 53, 44 to 47 ms \
|
| kernels compiled by processes of their own (warm-up where they are compiled first, and memory then: preset \
`default`; preset `visdrone`, which has 29 more of them than before) | 6.1 s, 298 MB; 7.3 s, 307 MB | 6.3 s, 256 MB; \
10.7 s, 279 MB |
| flow computed behind the answer, too (305, `uavdt_M1303`, answer on two cores, three runs in turn: mean; 95th \
percentile) | 18.9 to 19.3, 20.5 to 21.7; 27 to 28, 28 to 33 ms | 15.3 to 16.3, 17.0 to 19.2; 18 to 23, 20 to 25 ms |
| features for the next frame looked for after the answer instead of beside the flow (305, the same) | 15.3 to 16.3 \
ms | 14.2 to 14.9 ms |
| segments of a frame of over 40 by two threads (default, 100 objects; two runs in turn) | 82, 83 ms | 71, 74 ms |
| the photometric test of a segment by one kernel instead of five calls (KITTI, two cores, three runs in turn) | 26.2 \
to 27.5 ms | 25.9 to 26.2 ms |
| the ego-motion's second pass on the warped picture for turns and zooms over 5 % instead of 2 % (KITTI, two cores, \
mean; four runs in turn, with two threads; processor time) | 27.5 to 31.3; 36 to 44 ms | 24.6 to 28.7; 32 to 36 ms |
| freed memory stays with the process (`allocator.py`; page faults, frame) | 7 ms | 0 ms |
| in two heaps instead of one for each thread (`pipeline`, `visdrone`, 305 at 20 Hz, after 2 minutes, 40 s of them \
beside two busy loops) | 407 MB | 379 MB |
| `replay` writes in a thread of its own, its report reads ahead and packs beside the film (305, 136 frames, from \
start to report, three runs in turn) | 7.5 to 8.0 s | 7.1 to 7.4 s |
| check of flow by points, one box at a time (305, frame) | 1.4 ms | 0.4 ms |
| points of the ego-motion that fail without a pyramid are let go where they are under 5 % (one thread, ego-motion of \
305 / `uavdt_M1303`, two runs in turn; on KITTI more fail, nothing changes) | 9.0 / 9.8 ms | 8.2 / 8.6 ms |
| the same where they are under half, for KITTI (two cores, with frames of even brightness, which take 0.2 to 0.5 ms; \
two runs in turn, processor time) | 22.3, 27.5 ms; 38 to 47 ms | 20.7, 23.0 ms; 35 to 38 ms |
| window of the ego-motion's tracker 16 instead of 15 px, but for the preset `visdrone`: OpenCV handles 8 pixels of a \
row at once, the rest one by one (KITTI, one thread, ego-motion; 305 would gain 1 to 3 of 11 to 14 ms) | 25 to 28 ms \
| 17 ms |
| the same 16 px for the preset `visdrone` (305, in turn frame by frame: ego-motion of one thread; processor time of a \
frame on two cores) | 7.5; 47.8 ms | 5.6; 45.1 ms |
| points tracked back by halves, in two frames, instead of all in every second one (305, 339, `uavdt_M1303`, with the \
line above: 95th percentile over median, two runs of two hours) | 1.27, 1.25, 1.15 | 1.13, 1.09, 1.12 |
| corner response of a cell's own array, whose indices are never negative, instead of the image's (305, places of new \
points, in every second frame) | 4.2 ms | 3.2 ms |
| kernels fill arrays that their callers make, and have no wrapper for C (start of `pipeline` to its first message \
where they are compiled first, and memory then; two runs in turn, quiet machine) | 8.9 to 9.5 s, 406 MB | 6.3 to 6.6 \
s, 367 MB |
| what the start has freed is given back once (memory at that message) | 367 MB | 347 MB |
| points tracked in windows of 8 x 10 instead of 9 x 9 px, and what fails again from halved pictures (5000 points by \
one thread; the whole process over 260 frames of 305 and 160 of `uavdt_M1303`, one thread, processor time, six pairs \
in turn, whose ratios have the medians 0.99 and 0.95) | 3.2 ms; 12.2, 10.9 s | 2.8 ms; 12.2, 10.6 s |
| features of an even flight looked for where its last motion takes them, without seed points over a pyramid; points' \
way back without a pyramid; of points in one cell the first found with marks instead of numbers (305, `uavdt_M1303`; \
frame by frame in turn, a slower machine than the tables': processor time of two threads; frame to answer; processor \
time of one thread) | 1 | 0.95, 0.96; 0.87, 0.87; 0.96, 0.98 |
| neighbours of points by OpenCV's `Subdiv2D` instead of SciPy's `Delaunay`, the same edges but for a few at the rim, \
ten times a second; coarse windows of 8 instead of 12 px for points that fail; warps without perspective by the \
function for them (305, `uavdt_M1303`; frame by frame in turn, medians of three runs: processor time of two threads; \
frame to answer; the neighbours of 1800, 2400 points alone) | 1; 5.7, 7.9 ms | 0.97, 0.97; 1.00, 0.99; 2.2, 3.1 ms |
| threads of NumPy's OpenBLAS do not wait for their next call in a loop (`OPENBLAS_THREAD_TIMEOUT`; Python 3.12, NumPy \
1.26.4 and OpenCV 4.6.0 from PyPI, with the line above; processor time of 305 and KITTI with two threads, with one). \
NumPy 2's do not anyway | 98, 70; 102, 74 ms | 50, 39; 48, 37 ms |
| fragments are looked for beside larger objects only, instead of in all pairs (default, 100 objects, a frame) | 2.8 \
ms | 0.6 ms |
| of two patches the gap is looked at before their common box (65 segments of 8 patches each, about what 100 objects \
make) | 4.8 ms | 1.9 ms |
| processes that compile kernels import nothing else (0.43 instead of 0.89 s of processor time each), and take the \
next one when they are free (default, imports and warm-up where kernels are compiled first; a slower machine than the \
tables', four runs in turn) | 12.7 to 13.9 s | 11.9 to 12.9 s |
| errors of the background once a frame, where any segment asks for them, as whole numbers; those under an object's \
motion only where the background explains nothing; test, patches, motions and growth of all segments by one kernel \
each (frame, clustering stage of the default with 100 objects and of KITTI, a slower machine than the tables', in \
turn; first start after an installation, which pays for it) | 85 to 89, 40.5; 28 to 30, 12 ms; 8.4 to 8.5 s | 74 to \
76, 31 to 32; 26 to 28, 10.6 ms; 10.1 to 10.3 s |
| small objects' points: way forwards, failed ones and way back of a half of them by one thread, handed over once a \
frame instead of four times (clustering stage of 305, `uavdt_M1303`, the same machine) | 11.0, 12.1 ms | 10.7, 11.1 ms |
| threads that share a frame's work begin on another processor than the one that gives it: of 907 times on 305 Linux \
woke them on the same one in 421, where they began up to 1.0 ms later, now in one, 0.15 ms later at most in 95 of 100 \
(frame; 95th percentile; clustering stage of 305 and `uavdt_M1303`, a slower machine than the tables', two runs in \
turn; KITTI and 100 objects of the default: no change) | \
16.1, 17.8 to 18.2; 20.0 to 20.2, 22.3 to 22.7; 9.6 to 10.2, 9.8 to 9.9 ms | 13.6 to 13.9, 16.3; 16.6 to 16.9, 17.6 to \
17.8; 8.3 to 8.4, 8.8 to 8.9 ms |
| the same beside a busy loop (frame; 95th percentile) | 20.0 to 20.5, 23.4; 25.6 to 28.0, 29.7 to 30.4 ms | 16.8 to \
17.1, 19.4 to 19.5; 23.8 to 24.6, 25.4 to 27.3 ms |
| the same live (`soak --real --preset visdrone`, 305 at 20 Hz, two runs of 54 s in turn, the slower machine: image to \
detections, median; 95th percentile; dropped of 1080. 8 minutes of it, before and after, not in one hour: 83, 34 ms; \
451, 10 of 9600 dropped) | 36 to 52; 70 to 114 ms; 6 to 7 | 21 to 23; 34 to 55 ms; 0 to 3 |
| the same live with four nodes (`bench --parts transport_clip`, image to detections, median; at 10 Hz, two runs; at \
20 Hz, with which four processes overload this machine, three runs): little | 62 to 64; 45 to 100 ms | 60; 70 to 106 \
ms |
| `replay`: the flow, and the points with their motion, in threads of their own ahead of the objects, and each step \
does its frame with one thread instead of two (305, `uavdt_M1303`, KITTI, all but the start, a slow hour of the \
tables' machine, four runs in turn, the same bytes; ms a frame. One frame after the other: 44 to 64, 52 to 68, 37 to \
40) | 40 to 48, 47 to 68, 29 to 32 ms | 35 to 40, 41 to 56, 26 to 29 ms |
| figures of candidates stacked once a frame, one kernel for which points are usable (305, `uavdt_M1303`, 339; frame \
by frame in turn, medians of ratios: frame to answer; clustering stage) | 1; 1 | 0.97, 0.99, 0.99; 0.96, 0.97, 0.98 |
| all rows of a frame's detections formatted and written at once (20 detections: `detections.csv`; \
`detections.mcap`) | 0.20; 1.0 ms | 0.08; 0.9 ms |
| candidates of flow whose log odds are under -2, which is what a miss says, are none: about half of those there \
(default, 100 objects, none; four processes frame by frame in turn: frame; clustering stage) | 78, 47; 34, 4 ms | 74, \
46; 30, 4 ms |
| boxes of the points' clusters: those of one speed tested on the images together; what is brighter and darker than \
the ground marked once a frame (305, `uavdt_M1303`, KITTI, frame by frame in turn, medians of two to five runs, the \
same bytes: until what is behind the answer is done too; processor time; `replay`, wall over processor time, medians \
of six runs in turn). Where kernels are compiled first, one takes a second more | 1; 1; 0.605, 0.617, 0.588 | 0.98, \
0.98, 1.00; 0.98, 0.98, 1.00; 0.596, 0.602, 0.577 |
| kernels compiled by `colcon build` (start of `pipeline` to its first message after it, `default` and `visdrone`; the \
build, 3 s without it) | 8.0 to 10.3 s | 1.8, 1.9 s; 19 s |
| `replay`, `demo` and `tune` have missing kernels compiled by other processes first, and say so (first replay of 12 \
frames after an installation, `visdrone`, two runs in turn) | 23.5, 26.9 s | 15.5, 15.5 s |

| does not pay | |
|---|---|
| second half of a frame in a second thread, beside the first half of the next (305 live at 20 Hz) | 60 to 66 instead \
of 68 ms between answers, but these 195 to 219 instead of 91 to 96 ms old; processor time of a frame 69 to 87 ms |
| kernels compiled with less optimisation (`NUMBA_OPT=0`; before arrays were made outside of them) | 8.9 instead of \
12.5 s, and slower for good: over two thirds are numba's own work in Python |
| boxes of the points' clusters fitted in two threads (305, 28 clusters) | 23 instead of 22 ms: most of it holds \
Python's lock; with kernels 7.1 instead of 7.0 ms |
| planar and three-dimensional background fitted side by side (KITTI, eight runs in turn) | 27.2 instead of 27.5 ms: \
much of both holds Python's lock |
| segments of a frame of over 24 instead of 40 by two threads (KITTI, eight runs in turn) | 26.2 instead of 26.1 ms |
| points tracked back behind the answer too (305, a frame) | 1 to 2 ms less, but points that fail carry boxes, \
`uavdt_M1303` at IoU 0.5 0.517 to 0.470 |
| a Delaunay triangulation of our own in a kernel, the same edges as Qhull's | 0.5 ms where SciPy's took 4.2, ten \
times a second, behind the answer, for 130 lines; OpenCV's takes about 2 |
| neighbours of points by OpenCV's distance transform, which says where its cells touch (at half the resolution) | 3 \
instead of 6 ms, and a seventh of the edges are others |
| a shorter turn of Python's lock (1, 0.2 instead of 5 ms; `pipeline`, 305 live at 20 Hz, two runs) | 73 to 78, 68 to \
98 instead of 87 to 103 ms from image to detections beside other work on the machine: within its noise |
| pictures shrunk by bicubic interpolation instead of by area where they stay over 0.7 times as large (`uavdt_M1303`, \
a frame) | 0.5 instead of 1.6 ms, for 0.01 of F1 ([accuracy.md](accuracy.md#luck)) |
| seed points of the ego-motion tracked in halved pictures (960x540, a frame) | 0.5 instead of 1.2 ms, for 0.03 of F1 \
on KITTI ([accuracy.md](accuracy.md#luck)) |
| kernels for the normal equations of the ego-motion's and the background's samples, weights and cost | 0.1 ms a \
frame for 2 s of compiling |
| `replay`: reading, both halves of the work and writing in threads of their own (305, forwards and backwards, 544 \
frames, results the same; it stays) | 24.0 to 25.0 instead of 29.3 to 29.7 s, 1.2 times as fast, not the 1.6 hoped \
for: OpenCV's threads fill both cores already, and with one of them Python's lock is in the way; several inputs at \
once do better |
| the same later, all but the start, beside one frame after the other with its work behind the answer waited for \
(305, 272 frames, the same bytes) | 28 to 30 instead of 34 to 39 ms a frame; 43 ms of processor time on two cores are \
in the way, and that a frame's points wait for what the last one has shown |
| `replay`, with the flow and the points in threads of their own: each step with two threads instead of one; shorter \
turns of Python's lock (1, 0.2 ms); 4 or 8 instead of 2 frames between two steps (wall over processor time, which a \
slow hour hardly changes: 305, KITTI) | 0.63, 0.63; 0.59 to 0.60, 0.56 to 0.58; 0.59 instead of 0.59 to 0.60, 0.57 to \
0.59 |
| `replay`: a low priority for the threads that read and measure ahead | 28.1 instead of 30.1 ms a frame, on Linux \
only |
| segments of a frame of 29 by two threads (KITTI) | 26.4 to 27.4 instead of 25.9 to 27.2 ms, and 2 ms more processor \
time |
| kernels compiled with less optimisation, as kernels are now (all of the preset `visdrone`, processor time) | 22.3, \
22.2, 21.3, 17.6 s with `NUMBA_OPT` 3, 2, 1, 0 |
| kernels that call the same compiled by the same process (default, imports and warm-up where kernels are compiled \
first, three runs in turn, processor time) | 15.6 to 15.7 instead of 15.7 to 15.9 s: what a second process saves of \
its first kernel is numba's own start |
| processes that compile kernels started before the node has imported anything (default, start of `pipeline` to its \
first message where kernels are compiled first, three runs in turn) | 8.7 to 8.8 instead of 8.6 to 8.8 s |
| rows of the points' paths copied once instead of twice a frame | 0.33 instead of 0.44 ms |
| `replay`: the second half in a process of its own (the same) | 23.4 to 23.8 instead of 24.0 to 25.0 s: it is 41 of \
68 ms, and frames have to be sent; from the ninth frame on results differ in the sixth digit |
| neighbours of moving points by a distance transform instead of a k-d tree; errors of pictures by OpenCV's warps \
instead of a kernel (305, M1303, one thread) | -1 to +1 of 54 and 63 ms; 0 to +1 ms |
| samples of the image noise by two threads (default, KITTI) | 1.1, 0.27 to 1.0, 0.32 ms |
| kernels that are only called by kernels without a wrapper for Python (those of the photometric test and patches) | \
0.6 of 16.6 s of compiling, and no test could call them |
| one set of points for ego-motion and small objects | 4 to 5 of 60 ms of one thread, but see \
[accuracy.md](accuracy.md#what-was-tried) |
| places of new points: cells that did not change are left before their corners are looked at | 0.0 to 0.2 of 49 ms, \
the same bytes |
| smaller windows, fewer corners, longer intervals than these | 2 to 7 ms of 46, for 0.004 to 0.013 of mean F1 |

Over 30 minutes with the preset `visdrone` on 305, beside the whole test suites, memory rose for 18 minutes, while the
heaps found their size, and by 0.2 MB in the last 12; the first minutes of a run by itself: 20 ms, nothing dropped.

Of 49 ms a frame of 305 on one thread (cProfile) OpenCV's tracker takes 19 %, its dense flow 12 %, errors of pictures 4
%, corners of new points, warps 3 %, corners of the ego-motion 2 %; nothing else is over 2 %. The tracker's calls are
6000 points forwards in every frame and half of them backwards, and 700 of the ego-motion both ways.
'''
