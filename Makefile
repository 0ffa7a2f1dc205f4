# `make run` and `make test` need nothing but Python 3.10 or newer: each prepares its own environment.
PYTHON ?= python3
ROBOT := .venv-robot
DEV := .venv
OLDEST ?= $(shell for p in python3.10 "$$HOME"/.pyenv/versions/3.10*/bin/python; do \
	"$$p" -c "" 2>/dev/null && command -v "$$p" && break; done)
OLDEST_VENV := .venv-3.10
ARM := build/aarch64
PEERS := tests/support/peers/node_modules
WIRE := tests/firmware_bridge/guard tests/firmware_bridge/can tests/firmware_bridge/mavlink \
	tests/firmware_bridge/ros
ROS_COVERAGE := tests/support/ros/coverage.ini
ON_ARM := arm-policy arm-rest
arm-policy: TESTS := $(addprefix tests/edge_runtime/,policy guidance)
arm-rest: TESTS := $(addprefix tests/edge_runtime/,motion objectives control) \
	$(addprefix tests/firmware_bridge/,guard/test_core.py guard/test_wire.py can/test_codec.py can/test_e2e.py \
	can/test_layout.py mavlink/test_codec.py mavlink/test_signing.py) \
	tests/test_compatibility.py::test_a_log_of_an_earlier_version_replays
OLD_LOG := tests/support/artefacts/0.1.0/navigation.mcap
SOURCES := pyproject.toml $(wildcard edge_runtime/policy/_kernel*.[ch])
# Tests run on all cores, one thread each.
PYTEST := -m pytest -n auto --dist worksteal
export OMP_NUM_THREADS := 1

.PHONY: run test check lint types unit integration coverage oldest aarch64 sil budgets fuzz mutants \
	socketcan chromium peers docs wheels deb clean $(ON_ARM)

run: $(ROBOT)/ready  ## Four simulated robots reach their goals inside two objectives
	$(ROBOT)/bin/edge-run --robot-id 0

test: lint types unit  ## Is it correct? Minutes, and right on a busy machine too

check: test integration ros coverage oldest aarch64 sil budgets  ## Everything that CI checks

lint: $(DEV)/ready
	$(DEV)/bin/ruff check .
	$(DEV)/bin/ruff format --check .

types: $(DEV)/ready
	$(DEV)/bin/mypy

unit: $(DEV)/ready
	$(DEV)/bin/python $(PYTEST)

integration: $(DEV)/ready socketcan chromium peers  ## Against a kernel, a browser, other people's code; teams
	$(DEV)/bin/python -m pytest -m integration -n auto --dist loadfile --ignore=tests/firmware_bridge/ros

ros: $(DEV)/ready  ## Robots of ROS 1 and ROS 2 by other people's libraries, each line of the link run
	@PYTHON=$(DEV)/bin/python sh tests/support/ros/install.sh build/ros
	@if ! sh tests/support/ros/alone.sh true; then \
	    echo "no network namespace can be made here: skipping the tests against ROS"; \
	elif [ -e build/ros/node/installed.json ]; then rm -f build/ros/coverage* && \
	    sh tests/support/ros/alone.sh $(DEV)/bin/python -m coverage run --rcfile=$(ROS_COVERAGE) \
	    -m pytest -n 4 --dist worksteal -m "integration or not integration" tests/firmware_bridge/ros && \
	    $(DEV)/bin/python -m coverage combine -q --rcfile=$(ROS_COVERAGE) && \
	    $(DEV)/bin/python -m coverage report --rcfile=$(ROS_COVERAGE); fi

coverage: $(DEV)/ready  ## Every line and branch of the guard, both codecs and the ROS link is run by their own tests
	$(DEV)/bin/python -m coverage run -m pytest $(WIRE)
	$(DEV)/bin/python -m coverage report

oldest:  ## The runtime's own tests on the oldest Python
ifeq ($(OLDEST),)
	@echo "python3.10 is not installed: skipping the runtime's tests on the oldest Python"; test -z "$(CI)"
else
	@$(MAKE) --no-print-directory $(OLDEST_VENV)/ready
	$(OLDEST_VENV)/bin/python $(PYTEST)
endif

aarch64: $(DEV)/ready  ## The robot's processor, emulated: what computes actions and guards them
	@sh tests/support/aarch64/install.sh
	@if command -v qemu-aarch64 >/dev/null; then \
	    PYTHON=$(DEV)/bin/python sh tests/support/aarch64/prepare.sh $(ARM) && \
	    $(MAKE) --no-print-directory -j 2 $(ON_ARM) && \
	    rm -f $(ARM)/arm.mcap && \
	    sh tests/support/aarch64/python.sh $(ARM) tests/support/aarch64/decide.py $(OLD_LOG) $(CURDIR)/$(ARM)/arm.mcap && \
	    $(DEV)/bin/edge-replay $(ARM)/arm.mcap; fi

$(ON_ARM):  # halves that run beside each other
	CI=true sh tests/support/aarch64/python.sh $(ARM) -m pytest -p no:cacheprovider $(TESTS)

# What measures time ends with 3 if the machine was too busy to tell: it says so, and proves nothing.
sil: $(DEV)/ready  ## Teams of real processes in the loop, a few seconds each
	$(DEV)/bin/python -m benchmarks sil --short || test $$? -eq 3

budgets: $(DEV)/ready  ## The tick's speed, as ratios within one interleaved run
	$(DEV)/bin/python -m benchmarks latency --short || test $$? -eq 3

fuzz: $(DEV)/ready  ## Thousands of hostile files, a million frames at each decoder; `make test` takes fewer
	$(DEV)/bin/python $(PYTEST) tests/fuzz --fuzz
	$(DEV)/bin/python -m pytest tests/firmware_bridge/can/test_codec.py -k junk --hypothesis-profile=fuzz
	MAVLINK_FUZZ_CASES=1000000 $(DEV)/bin/python -m pytest tests/firmware_bridge/mavlink/test_codec.py -k fuzz

mutants: $(DEV)/ready  ## Changes guard, codecs and the ROS link in every small way: a test must fail each time
	$(DEV)/bin/pip install --quiet --editable '.[dev,mutation]'
	$(DEV)/bin/mutmut run
	$(DEV)/bin/mutmut results

docs: $(DEV)/ready  ## build/site/index.html: tutorial, how-to, reference, explanation
	$(DEV)/bin/python -m mkdocs build --quiet --site-dir build/site

wheels:  ## dist/: wheels with the kernel inside, sdist, SBOM, licences, of the last commit; minutes
	PYTHON=$(PYTHON) sh packaging/wheels.sh dist

deb: wheels  ## dist/: Debian packages that need no network
	sh packaging/deb.sh dist

socketcan:  ## What the tests on a real CAN bus boot; skips where it cannot be installed
	@sh tests/support/socketcan/install.sh

chromium:  ## The browser in which reports are tested; its tests skip where it cannot be installed
	@sh tests/support/chromium/install.sh

peers:  ## Other people's MAVLink for Node; its tests skip where npm is missing, but not in CI
ifeq ($(shell command -v npm),)
	@echo "npm is not installed: skipping the tests against node-mavlink"; test -z "$(CI)"
else
	@$(MAKE) --no-print-directory $(PEERS)/.ready
endif

# One environment per need: the robot's is small; the workstation's holds PyTorch and VMAS.
$(ROBOT)/ready: EXTRAS :=
$(DEV)/ready: EXTRAS := [dev]
$(OLDEST_VENV)/ready: EXTRAS := [test]
$(OLDEST_VENV)/ready: PYTHON = $(OLDEST)
$(ROBOT)/ready $(DEV)/ready $(OLDEST_VENV)/ready: $(SOURCES)
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/pip install --quiet --upgrade pip  # an old one's resolver may search for hours
	$(@D)/bin/pip install --quiet --editable '.$(EXTRAS)'
	touch $@

$(PEERS)/.ready: tests/support/peers/package.json
	npm install --prefix tests/support/peers --no-package-lock --no-audit --no-fund --loglevel=error
	touch $@

clean:
	rm -rf $(PEERS) tests/support/socketcan/build $(ROBOT) $(DEV) $(OLDEST_VENV) mutants build dist *.egg-info
