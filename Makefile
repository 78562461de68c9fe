# make demo and make test need nothing but Python 3.11 or 3.12 with venv; each sets up .venv by itself.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
EXTRAS := .venv-extras
JAZZY := .venv-jazzy
AUDIT := .venv-audit
# A python3.12 that really runs: a shim of pyenv does not where another version is selected, so its versions are tried too.
PYTHON_JAZZY ?= $(shell for python in python3.12 "$$(pyenv root 2>/dev/null)"/versions/3.12.*/bin/python3.12; do \
  "$$python" -c 'import ensurepip, venv' 2>/dev/null && { echo "$$python"; break; }; done)

export VIRTUAL_ENV := $(CURDIR)/$(VENV)
export AMENT_PREFIX_PATH := $(VIRTUAL_ENV)
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
export ROS_HOME ?= $(CURDIR)/$(VENV)/ros_home

# Processes of pytest, a file of tests each: they wait more than they compute.
JOBS ?= 3
# Long files come first (test/conftest.py).
PARALLEL := -n $(JOBS) --dist loadfile --no-loadscope-reorder

.PHONY: setup demo test test-timing test-soak test-extras test-jazzy check-aarch64 reliability lint bench audit sbom clean

setup: $(STAMP)

$(STAMP): requirements.lock setup.py setup.cfg pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' || \
	  { echo "motion_detect_ros: expected Python 3.11 or 3.12 as $(PYTHON), got $$($(PYTHON) --version 2>&1); set PYTHON=" >&2; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { echo "motion_detect_ros: $(PYTHON) has no venv module; install python3-venv" >&2; exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@mkdir -p $(VENV)/lib/motion_detect_ros
	@for node in camera ego_motion optical_flow art2_clustering pipeline overlay bag_player; do \
	  ln -sf ../../bin/$$node $(VENV)/lib/motion_detect_ros/$$node; done
	@touch $@

demo: $(STAMP)
	$(BIN)/python -m motion_detect_ros demo

# Passes on a busy machine too.
test: lint
	$(BIN)/python -m pytest $(PARALLEL) -m "not timing and not soak" $(PYTEST_ARGS)

# What measures time (latency, rates, drops at a rate) needs a machine with nothing else to do.
test-timing: $(STAMP)
	$(BIN)/python -m pytest -m timing $(PYTEST_ARGS)

# Minutes of overload, kills, cut streams and clock steps; SOAK_MINUTES=30 adds a long run.
test-soak: $(STAMP)
	$(BIN)/python -m pytest -m soak $(PYTEST_ARGS)

# Runs the tests that show a row of docs/reliability.md and writes the page. Needs a machine with nothing else to do.
reliability: $(STAMP)
	$(BIN)/python -m pytest --reliability docs/reliability.md $$(grep -rl "shown(" test --include='test_*.py')

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/mypy

# The tests of optional flow methods, TrackEval, motmetrics, scikit-learn and matplotlib, in an environment of their own:
# contrib replaces the OpenCV of .venv.
test-extras: $(EXTRAS)/.ready
	$(EXTRAS)/bin/python -m pytest -p no:cacheprovider test/core/optical_flow/test_optical_flow.py \
	  test/core/flow_methods/test_onnx_flow.py test/results/test_identity.py test/cli/test_evaluate.py \
	  test/benchmarks/test_ablation.py test/benchmarks/test_figures.py test/benchmarks/test_plain_methods.py \
	  test/results/test_detection_text.py test/test_art2_clusterer.py

$(EXTRAS)/.ready: setup.py
	$(PYTHON) -m venv $(EXTRAS)
	$(EXTRAS)/bin/pip install --quiet --disable-pip-version-check \
	  apsw mcap numba rosbags scipy PyYAML rich opencv-contrib-python-headless onnxruntime onnx 'scikit-learn>=1.6' matplotlib \
	  hypothesis motmetrics pytest pytest-timeout
	$(EXTRAS)/bin/pip install --quiet --disable-pip-version-check --no-deps trackeval
	@touch $@

# The tests under the Python, NumPy, SciPy and OpenCV of Ubuntu 24.04, where ROS 2 Jazzy is at home. test_packaging.py
# and the benchmarks compare with requirements.lock. Of the long silent flights one is flown here; tests of processes,
# signals and messages (marker `messages`) are left to make test.
SILENT := test/core/trajectories/test_silence.py::test_at_most_one_false_box_in_a_hundred_frames
OTHER_SEEDS := $(foreach case,1-kitti 2-visdrone 2-kitti 3-visdrone 3-kitti,--deselect '$(SILENT)[$(case)]')
test-jazzy: export VIRTUAL_ENV := $(CURDIR)/$(JAZZY)
test-jazzy: export AMENT_PREFIX_PATH := $(CURDIR)/$(JAZZY)
test-jazzy: export ROS_HOME := $(CURDIR)/$(JAZZY)/ros_home
test-jazzy: export PYTHONPATH := $(CURDIR)
test-jazzy: $(JAZZY)/.ready
	$(JAZZY)/bin/python -m pytest -p no:cacheprovider $(PARALLEL) -m "not timing and not soak and not messages" test/core test/sources test/results test/report test/tuning test/bridge test/cli test/nodes test/faults test/examples $(OTHER_SEEDS) $(PYTEST_ARGS)

$(JAZZY)/.ready: requirements-jazzy.lock
	@test "$$($(or $(PYTHON_JAZZY),false) --version 2>/dev/null | cut -d. -f1,2)" = 'Python 3.12' || \
	  { echo "motion_detect_ros: expected Python 3.12 with venv, got $(or $(PYTHON_JAZZY),none); set PYTHON_JAZZY=" >&2; exit 2; }
	$(PYTHON_JAZZY) -m venv $(JAZZY)
	$(JAZZY)/bin/pip install --quiet --disable-pip-version-check -r requirements-jazzy.lock
	@touch $@

# Every dependency but ROS, in the locked versions, exists as a binary for the computers of most drones.
REQUIRED := 'from importlib.metadata import requires; print(*[r for r in requires("motion_detect_ros") if "extra ==" not in r], sep="\n")'
check-aarch64: $(STAMP)
	@folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && $(BIN)/python -c $(REQUIRED) > "$$folder/required.txt" && \
	  $(BIN)/pip download --quiet --disable-pip-version-check --dest "$$folder" --only-binary=:all: \
	    --platform manylinux2014_aarch64 --platform manylinux_2_28_aarch64 --python-version 3.12 \
	    -r "$$folder/required.txt" -c requirements.lock && cd "$$folder" && ls -- *.whl

# Known weaknesses of the locked versions, as PyPI tells them, and the licences. What PyPI could not be asked about fails too.
audit: $(STAMP) $(AUDIT)/.ready
	$(BIN)/python -m motion_detect_ros.benchmarks.dependencies --write docs/dependencies.md > /dev/null
	$(AUDIT)/bin/pip-audit --strict --no-deps --disable-pip --progress-spinner off -r requirements.lock || \
	  { echo "audit: weaknesses were found, or PyPI could not be asked (see above); the licences are fine" >&2; exit 1; }

# A bill of materials of .venv, checked against the schema of CycloneDX.
sbom: $(STAMP) $(AUDIT)/.ready
	@mkdir -p out
	$(AUDIT)/bin/cyclonedx-py environment --validate --output-reproducible --sv 1.6 --of JSON -o out/sbom.json $(BIN)/python

$(AUDIT)/.ready:
	$(PYTHON) -m venv $(AUDIT)
	$(AUDIT)/bin/pip install --quiet --disable-pip-version-check pip-audit cyclonedx-bom
	@touch $@

bench: $(STAMP)
	$(BIN)/python -m motion_detect_ros bench

clean:
	rm -rf $(VENV) $(EXTRAS) $(JAZZY) $(AUDIT) build install log out *.egg-info
