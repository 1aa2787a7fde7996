# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
# make demo    set everything up and run the main job        make bench    compare, time, report; QUICK=1 for less
# make test    set everything up and pass the tests          make lint     ruff and mypy alone
# make setup   set up alone                                  make clean    remove all that make made
# make words   words and sentences of the pages              make docs     the site, in out/site
# make lines   budgets of the house beside its lines         make bench-check  quick benches beside the golden figures
#
# JOBS=1 and BENCH_JOBS=1 run tests and benches one at a time (2 and 4).
#
# PYTHON=python3.12 and DISTRO=jazzy choose another Python (3.10 to 3.14) or another ROS 2; both
# make .venv and install anew.
#
# The environment's Python takes the package from this folder and the generated interfaces from
# install/, so an edited source needs no build. install/ holds links to the sources (colcon's
# --symlink-install) and is a whole workspace when install/setup.bash is sourced.

PYTHON ?= python3
OLDEST ?= python3.10
DISTRO ?= kilted
CONFIGURE := bootstrap/configure.py
JOBS ?= 2
BENCH_JOBS ?= 4
RESULTS := benchmarks/results
ARGUMENTS ?=

# DDS stays on this machine and logs stay in this folder, unless asked otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE ?= LOCALHOST
export ROS_LOG_DIR ?= $(CURDIR)/log/ros

# A sourced ROS would win over the one in .venv: set-up says that it is left out, and this does it.
SOURCED := AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH PYTHONPATH PYTHONHOME \
  LD_LIBRARY_PATH ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION ROS_PACKAGE_PATH RMW_IMPLEMENTATION \
  ROS_ETC_DIR VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE
ALONE := env $(addprefix -u ,$(SOURCED))

.PHONY: help setup setup-tests demo test test-oldest test-lerobot lint bench bench-check docs lines words lock clean

help:
	@sed -n '1,5s/^# //p' Makefile

setup: python
	@$(PYTHON) $(CONFIGURE) --distro $(DISTRO)

setup-tests: python
	@$(PYTHON) $(CONFIGURE) --distro $(DISTRO) --tests

.PHONY: python
python:
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) was not found: install Python 3.10 to 3.14 or name one with make PYTHON=NAME."; exit 1; }

demo: setup
	@.venv/bin/tactile demo $(ARGUMENTS)

bench: setup-tests
	@.venv/bin/tactile bench all $(if $(QUICK),--quick) --jobs $(BENCH_JOBS) --figures $(RESULTS) $(ARGUMENTS); \
	  code=$$?; .venv/bin/tactile report $(RESULTS) && exit $$code

# The quick benches beside the golden figures: accuracy, coverage and counts that are worse.
bench-check: setup-tests
	@mkdir -p out && .venv/bin/tactile bench all --quick --jobs $(BENCH_JOBS) --results out/bench_check > out/bench_check.log || { tail out/bench_check.log; exit 1; }
	@.venv/bin/python benchmarks/golden/compare.py out/bench_check

# Lines, files and exceptions of every folder beside their budgets.
lines:
	@$(firstword $(wildcard .venv/bin/python) $(PYTHON)) test/house.py

# Site of the documentation; broken links end it.
docs: setup-tests
	@NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build -q && echo 'python3 -m http.server -d out/site'

# Words of every page, mean and longest sentence.
words:
	@$(PYTHON) docs/count_words.py

lint: setup-tests
	@$(ALONE) .venv/bin/ruff check .
	@if $(ALONE) .venv/bin/python -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then \
	  $(ALONE) .venv/bin/mypy; \
	else echo 'mypy is left out: the last NumPy for Python 3.10 describes its arrays otherwise'; fi

# A file of tests stays in one process; each process has a ROS domain of its own.
test: lint
	@$(ALONE) .venv/bin/python -m pytest -n $(JOBS) --dist loadfile $(ARGUMENTS)

# The core (all but ROS and the command line) on the oldest wheels there are.
test-oldest:
	@$(OLDEST) $(CONFIGURE) --oldest
	@$(ALONE) .venv-oldest/bin/python -m pytest -m 'not ros' $(ARGUMENTS)

# The data set of `tactile export` as lerobot reads it, in an environment of its own with torch.
test-lerobot:
	@$(PYTHON) -m venv .venv-lerobot
	@$(ALONE) .venv-lerobot/bin/pip install -q lerobot lz4 mcap numba rosbags scipy zstandard hypothesis pytest
	@$(ALONE) .venv-lerobot/bin/python -m pytest test/evaluation/test_lerobot.py

# After an edit of bootstrap/locks/*.in; needs uv in the Python that runs it.
lock:
	$(PYTHON) bootstrap/lock.py

clean:
	rm -rf .venv .venv-oldest .venv-lerobot build install log out
