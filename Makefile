# `make run` and `make test` need nothing but Python 3.10 or newer: each prepares its own environment.
PYTHON ?= python3
ROBOT := .venv-robot
DEV := .venv
OLDEST ?= $(shell for p in python3.10 "$$HOME"/.pyenv/versions/3.10*/bin/python; do \
	"$$p" -c "" 2>/dev/null && command -v "$$p" && break; done)
OLDEST_VENV := .venv-3.10

.PHONY: run test lint types unit socketcan oldest clean

run: $(ROBOT)/ready  ## Four simulated robots reach their goals inside two objectives
	$(ROBOT)/bin/edge-run --robot-id 0

test: lint types unit oldest  ## Everything that CI checks

lint: $(DEV)/ready
	$(DEV)/bin/ruff check .
	$(DEV)/bin/ruff format --check .

types: $(DEV)/ready
	$(DEV)/bin/mypy

unit: $(DEV)/ready socketcan
	$(DEV)/bin/python -m pytest

socketcan:  ## What the tests on a real CAN bus boot; skips where it cannot be installed
	@sh tests/socketcan/install.sh

oldest:  ## The runtime's own tests on the oldest Python
ifeq ($(OLDEST),)
	@echo "python3.10 is not installed: skipping the runtime's tests on the oldest Python"; test -z "$(CI)"
else
	@$(MAKE) --no-print-directory $(OLDEST_VENV)/ready
	$(OLDEST_VENV)/bin/python -m pytest --ignore=tests/test_socketcan.py
endif

# One environment per need: the robot's is small; the workstation's holds PyTorch and VMAS.
$(ROBOT)/ready: pyproject.toml
	$(PYTHON) -m venv $(ROBOT)
	$(ROBOT)/bin/pip install --quiet --editable .
	touch $@

$(DEV)/ready: pyproject.toml
	$(PYTHON) -m venv $(DEV)
	$(DEV)/bin/pip install --quiet --editable '.[dev]'
	touch $@

$(OLDEST_VENV)/ready: pyproject.toml
	$(OLDEST) -m venv $(OLDEST_VENV)
	$(OLDEST_VENV)/bin/pip install --quiet --editable '.[test]'
	touch $@

clean:
	rm -rf $(ROBOT) $(DEV) $(OLDEST_VENV) build dist *.egg-info
