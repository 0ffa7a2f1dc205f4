# `make run` and `make test` need nothing but Python 3.10 or newer: each prepares its own environment.
PYTHON ?= python3
ROBOT := .venv-robot
DEV := .venv
OLDEST ?= $(shell for p in python3.10 "$$HOME"/.pyenv/versions/3.10*/bin/python; do \
	"$$p" -c "" 2>/dev/null && command -v "$$p" && break; done)
OLDEST_VENV := .venv-3.10
PEERS := tests/support/peers/node_modules
WIRE := tests/firmware_bridge/guard tests/firmware_bridge/can tests/firmware_bridge/mavlink
SOURCES := pyproject.toml $(wildcard edge_runtime/policy/_kernel*.[ch])

.PHONY: run test lint types unit budgets sil coverage fuzz socketcan chromium peers mutants oldest clean

run: $(ROBOT)/ready  ## Four simulated robots reach their goals inside two objectives
	$(ROBOT)/bin/edge-run --robot-id 0

test: lint types unit coverage oldest budgets sil  ## Everything that CI checks

lint: $(DEV)/ready
	$(DEV)/bin/ruff check .
	$(DEV)/bin/ruff format --check .

types: $(DEV)/ready
	$(DEV)/bin/mypy

unit: $(DEV)/ready socketcan chromium  ## All tests but those that `coverage` runs
	$(DEV)/bin/python -m pytest $(addprefix --ignore=,$(WIRE))

budgets: $(DEV)/ready  ## The tick's speed, as ratios within one interleaved run
	OMP_NUM_THREADS=1 $(DEV)/bin/python -m benchmarks latency --short

chromium:  ## The browser in which reports are tested; its tests skip where it cannot be installed
	@sh tests/support/chromium/install.sh

sil: $(DEV)/ready  ## Teams of real processes in the loop, a few seconds each
	$(DEV)/bin/python -m benchmarks sil --short

socketcan:  ## What the tests on a real CAN bus boot; skips where it cannot be installed
	@sh tests/support/socketcan/install.sh

peers:  ## Other people's MAVLink for Node; its tests skip where npm is missing, but not in CI
ifeq ($(shell command -v npm),)
	@echo "npm is not installed: skipping the tests against node-mavlink"; test -z "$(CI)"
else
	@$(MAKE) --no-print-directory $(PEERS)/.ready
endif

coverage: $(DEV)/ready peers  ## Every line and branch of the guard and both codecs is run by their own tests
	OMP_NUM_THREADS=1 $(DEV)/bin/python -m coverage run -m pytest $(WIRE)
	$(DEV)/bin/python -m coverage report

fuzz: $(DEV)/ready  ## A million malformed or random frames at each decoder; CI sends fewer
	$(DEV)/bin/python -m pytest tests/firmware_bridge/can/test_codec.py -k junk --hypothesis-profile=fuzz
	MAVLINK_FUZZ_CASES=1000000 $(DEV)/bin/python -m pytest tests/firmware_bridge/mavlink/test_codec.py -k fuzz

mutants: $(DEV)/ready  ## Changes the guard and both codecs in every small way: a test must fail each time
	$(DEV)/bin/pip install --quiet --editable '.[dev,mutation]'
	$(DEV)/bin/mutmut run
	$(DEV)/bin/mutmut results

oldest: peers  ## The runtime's own tests on the oldest Python
ifeq ($(OLDEST),)
	@echo "python3.10 is not installed: skipping the runtime's tests on the oldest Python"; test -z "$(CI)"
else
	@$(MAKE) --no-print-directory $(OLDEST_VENV)/ready
	$(OLDEST_VENV)/bin/python -m pytest --ignore=tests/firmware_bridge/can/test_socketcan.py
endif

# One environment per need: the robot's is small; the workstation's holds PyTorch and VMAS.
$(ROBOT)/ready: $(SOURCES)
	$(PYTHON) -m venv $(ROBOT)
	$(ROBOT)/bin/pip install --quiet --editable .
	touch $@

$(DEV)/ready: $(SOURCES)
	$(PYTHON) -m venv $(DEV)
	$(DEV)/bin/pip install --quiet --editable '.[dev]'
	touch $@

$(OLDEST_VENV)/ready: $(SOURCES)
	$(OLDEST) -m venv $(OLDEST_VENV)
	$(OLDEST_VENV)/bin/pip install --quiet --editable '.[test]'
	touch $@

$(PEERS)/.ready: tests/support/peers/package.json
	npm install --prefix tests/support/peers --no-package-lock --no-audit --no-fund --loglevel=error
	touch $@

clean:
	rm -rf $(PEERS) tests/support/socketcan/build $(ROBOT) $(DEV) $(OLDEST_VENV) mutants build dist *.egg-info
