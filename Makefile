# make animate   from nothing to a moving cloth        make train   from nothing to a learned fabric
# make test      from nothing to the whole test suite
PYTHON ?= python3.11
VENV   ?= .venv
DATA   ?= cloth
# installed before everything else, so that nothing brings another build
TORCH       ?= torch==2.13.0

RUN := PYTHONPATH=src $(VENV)/bin/python
INSTALLED := $(VENV)/.installed
BLENDER_LIBRARIES := libgl1 libsm6 libice6 libx11-6 libxext6 libxfixes3 libxi6 libxrender1 libxkbcommon0
BLENDER_SONAMES := libGL.so.1 libSM.so.6 libICE.so.6 libX11.so.6 libXext.so.6 libXfixes.so.3 libXi.so.6 \
                   libXrender.so.1 libxkbcommon.so.0

.DEFAULT_GOAL := help
.PHONY: help install animate data train report test lint clean

help:  ## this list
	@sed -n 's/^\([a-z]*\):.*##\(.*\)/make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 16

install: $(INSTALLED)  ## virtual environment with everything in it

$(INSTALLED): pyproject.toml | $(VENV)/bin/python system-libraries
	@echo "installing into $(VENV): PyTorch first, in its CPU build (about 3 minutes in all)"
	$(VENV)/bin/pip install "$(TORCH)"
	$(VENV)/bin/pip install --editable ".[blender,dev]"
	@touch $@

# Debian's own Python lacks the module that makes virtual environments until it is installed.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null || { \
	  echo "error: $(PYTHON) is not there or is not Python 3.11, the version that Blender's wheel is made for;" \
	       "install it (Debian 12: apt-get install python3.11 python3.11-venv) or name it: make PYTHON=/path/to/python3.11"; \
	  exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || $(call debian,python3.11-venv,the venv module of Python)
	$(PYTHON) -m venv $(VENV)

.PHONY: system-libraries
system-libraries: | $(VENV)/bin/python
	@$(VENV)/bin/python -c 'import ctypes, sys; [ctypes.CDLL(name) for name in sys.argv[1:]]' $(BLENDER_SONAMES) 2>/dev/null \
	  || $(call debian,$(BLENDER_LIBRARIES),shared libraries that Blender needs)

# $(call debian,packages,what they are): install with apt-get where that is allowed, else say how
debian = if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    echo "installing $(2): $(1)"; \
	    apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -qq -y $(1) >/dev/null; \
	  else echo "error: $(2) are missing; run: sudo apt-get install $(1)"; exit 1; fi

animate: install  ## silk over a moving sphere, by the energy that comes with the program; no training
	$(RUN) src/animate.py

data: install  ## trajectories of a cloth, by Blender; goes on where it was interrupted
	$(RUN) src/generate.py data=$(DATA)

train: install data  ## the data if they are not there, then the paper's EUNet and ours, their test, table and figure
	$(RUN) src/train.py data=$(DATA) model=eunet
	$(RUN) src/train.py data=$(DATA) model=eunet_hinge
	$(RUN) src/report.py
	@echo "figure: runs/report/energy_map.png    table: runs/report/tables.md"
	@echo "dashboard: $(VENV)/bin/tensorboard --logdir runs, then open the address that it prints in a browser"

report:  ## tables and figures of all finished runs
	$(RUN) src/report.py

test: install  ## the whole test suite, on all cores
	$(RUN) -m pytest -n logical --dist worksteal

lint: install  ## what pre-commit and the tests check as well
	$(VENV)/bin/ruff check src tests
	PYTHONPATH=src $(VENV)/bin/lint-imports
	$(VENV)/bin/mypy

clean:  ## caches only; data and runs stay
	rm -rf .pytest_cache .ruff_cache .import_linter_cache build src/*.egg-info
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
