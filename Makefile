# Everything starts here: `make help`.

PYTHON ?= python3
PRESET ?= case3
PYTEST_ARGS ?=
BENCH_ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --no-deps --no-compile

# ROS stays on this machine unless the command line says otherwise.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
export PYTHONNOUSERSITE := 1
export ROS_LOG_DIR ?= $(CURDIR)/.ros/log
export MPLCONFIGDIR ?= $(CURDIR)/.cache/matplotlib
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# Where ROS comes from: wheels of Jazzy, or the ROS 2 that is sourced. There the system's numpy is
# what ROS was built against and stays; --no-deps keeps pip from replacing it or anything of ROS.
ifneq ($(filter $(ROS_DISTRO),jazzy kilted lyrical),)
ROS := $(ROS_DISTRO)
VENV_OPTIONS := --system-site-packages
REQUIREMENTS := requirements/runtime.txt
WITHOUT := numpy
CHECK := true
else
ROS := wheels
VENV_OPTIONS :=
REQUIREMENTS := requirements/ros-wheels.txt requirements/runtime.txt
WITHOUT := nothing
CHECK := $(BIN)/python -m pip check --quiet
endif

# Kernels are compiled while all else is installed; several goals are made one after the other.
ifneq ($(filter 0 1,$(words $(MAKECMDGOALS))),)
MAKEFLAGS += --jobs=2
endif

# Stamps are written last and in one move: what was interrupted is begun again.
NUMERICS := $(VENV)/.numerics
ENVIRONMENT := $(VENV)/.environment
DEVELOPMENT := $(VENV)/.development
PACKAGE := $(VENV)/.package
KERNELS := $(VENV)/.kernels
DEMO_KERNELS := $(KERNELS)-$(subst /,_,$(PRESET))
SOURCES := $(shell find cmpsp_ros -name '*.py')
MADE_FOR := $(CURDIR) with ROS from $(ROS)
# What kernels are compiled with; the other packages have no part in them.
NUMERICAL := numpy|scipy|numba|llvmlite|pyyaml|clarabel|cffi|pycparser|pillow

# An environment is bound to its place, to its ROS and to its Python (when one is asked for).
ifneq ($(wildcard $(NUMERICS)),)
ifneq ($(shell cat $(VENV)/.made-for 2>/dev/null),$(MADE_FOR))
$(NUMERICS): FORCE
else ifeq ($(shell $(BIN)/python -c 'print(1)' 2>/dev/null),)
$(NUMERICS): FORCE
else ifneq ($(origin PYTHON),file)
which_python = $(shell $(1) -c 'import sys; print(sys.version_info[:2])' 2>/dev/null)
ifneq ($(call which_python,$(BIN)/python),$(call which_python,$(PYTHON)))
$(NUMERICS): FORCE
endif
endif
endif

# Not a target of its own: a recipe line with $(MAKE) in it would run even under `make -n`.
define CHECK_PYTHON
$(PYTHON) -c '' 2>/dev/null || { \
    echo "error: '$(PYTHON)' does not run. Name a Python 3.11 or newer: make PYTHON=python3.12" >&2; exit 1; }; \
$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
    echo "error: $$($(PYTHON) --version) is too old. Name a Python 3.11 or newer:" >&2; \
    echo "       make PYTHON=python3.12" >&2; exit 1; }; \
$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
    echo "error: $(PYTHON) has no venv module. On Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
endef
ifneq ($(ROS),wheels)
define CHECK_ROS_PYTHON
$(PYTHON) -c 'import rclpy' 2>/dev/null || { \
    echo "error: ROS_DISTRO is $(ROS), but $(PYTHON) cannot import rclpy. Is it sourced, and this" >&2; \
    echo "       its own Python (3.12; Lyrical: 3.14)? Without a ROS: unset ROS_DISTRO, and the wheels do." >&2; exit 1; }; \
$(PYTHON) -c 'import numpy' 2>/dev/null || { \
    echo "error: $(PYTHON) has no numpy. On Ubuntu: apt install python3-numpy" >&2; exit 1; }
endef
else
CHECK_ROS_PYTHON := true
endif

define RUN_TESTS
@$(BIN)/cmpsp warmup > $(VENV)/compile.log || { cat $(VENV)/compile.log >&2; exit 1; }
$(BIN)/python -m pytest -n 2 --dist loadgroup $(WHICH) $(PYTEST_ARGS)
endef

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test test-all test-oldest test-newest lint setup bench docs pictures dist site lock clean check-ros FORCE

help:  ## say what can be made
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: check-ros $(PACKAGE) $(DEMO_KERNELS)  ## watch the robot drive: PRESET=case3
	$(BIN)/cmpsp demo $(PRESET)

test test-all test-oldest test-newest: export ROS_PYTHON_CHECK_FIELDS := 1
# Rewritten assertions are kept, else each worker and each program that tests start makes them again.
test test-all test-oldest test-newest: export PYTHONDONTWRITEBYTECODE :=
test test-oldest test-newest: WHICH := -m 'not slow'
test: setup  ## run the tests that take minutes together; more options for pytest in PYTEST_ARGS
	$(RUN_TESTS)

test-all: WHICH :=
test-all: setup  ## run all tests: studies, fuzzers, all real nodes, colcon (doc/reference/testing.md)
	$(RUN_TESTS)

# Environments of their own; matplotlib 3.6 has no wheel for Python 3.12, and is built.
test-oldest: export MPLSETUPCFG := $(CURDIR)/requirements/matplotlib.cfg
test-oldest: CONSTRAINT := -c requirements/oldest.txt
test-oldest:  ## the same with the oldest versions, Ubuntu 24.04's: PYTHON=python3.12 (requirements/README.md)
test-newest:  ## the same with the newest versions of everything: PYTHON=python3.14
test-oldest test-newest: VENV = .cache/$(@:test-%=%)
test-oldest test-newest: BIN = $(VENV)/bin
test-oldest test-newest:
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet $(CONSTRAINT) -e '.[ros,solvers,report,test]'
	$(RUN_TESTS)

lint: check-ros $(DEVELOPMENT) $(PACKAGE)  ## ruff, mypy, who may import whom, and through which door
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m mypy
	$(BIN)/lint-imports
	$(BIN)/python .ci/house_rules.py
	$(BIN)/python .ci/noble.py

setup: check-ros $(DEVELOPMENT) $(KERNELS)  ## make .venv, with ROS 2 Jazzy from wheels unless one is sourced

bench: setup  ## time the control steps, more options in BENCH_ARGS; doc/reference/performance.md has a run
	$(BIN)/python -m benchmarks $(BENCH_ARGS)

docs: setup  ## write doc/reference/topics.md and parameters.md, config/defaults.yaml and cmpsp.policy.xml
	$(BIN)/python .ci/documentation.py
	$(BIN)/python -m cmpsp_ros.nodes.security_policy config/cmpsp.policy.xml

# Benchmark and examples draw theirs with their own pages: `make bench`, `python -m examples`.
pictures: setup  ## draw doc/images/ and run the table of doc/user/presets.md again; needs chromium
	$(BIN)/python .ci/pictures.py

# Pages are copied, because they link to files beside doc/. Commands and API are of this tree.
site: PAGES := .cache/pages
site: $(PACKAGE)  ## build a site of the documentation into site/; a dead link is an error
	test -x .cache/site/bin/mkdocs || { $(PYTHON) -m venv .cache/site; \
	    .cache/site/bin/pip install --quiet -r requirements/site.txt; }
	rm -rf $(PAGES)
	mkdir -p $(PAGES)
	cp -r README.md CONTRIBUTING.md CHANGELOG.rst LICENSE config doc $(PAGES)
	$(BIN)/python .ci/documentation.py $(PAGES)/doc/reference
	NO_MKDOCS_2_WARNING=1 .cache/site/bin/mkdocs build
	@echo 'site/doc/start.html'

dist: $(DEVELOPMENT)  ## build the sdist and the wheel into dist/
	rm -rf dist build
	$(BIN)/python setup.py --quiet sdist bdist_wheel
	ls -l dist

lock:  ## pin today's newest versions in requirements/
	@$(CHECK_PYTHON)
	rm -rf .cache/lock
	$(PYTHON) -m venv .cache/lock
	.cache/lock/bin/python requirements/lock.py
	rm -rf .cache/lock

clean:  ## remove the environment and whatever can be made again (runs/ stays)
	rm -rf $(VENV) build dist site install log .ros .cache .mypy_cache .pytest_cache .ruff_cache .hypothesis
	rm -rf .import_linter_cache .coverage htmlcov *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

check-ros:
	@if [ -n "$$ROS_DISTRO" ] && [ '$(ROS)' = wheels ]; then \
	    echo "error: ROS 2 '$$ROS_DISTRO' is sourced; this package is for Jazzy, Kilted and Lyrical." >&2; \
	    echo "       Source one of them, or use a shell without any ROS: the wheels do then." >&2; exit 1; fi

# Same pins as in the environment that is there: a new date on the files is no reason to begin again.
# Side by side, and nothing is compiled that is not imported: that would take half of the time.
$(NUMERICS): $(REQUIREMENTS) | check-ros
	@if [ "$$(cat $(VENV)/.made-for 2>/dev/null)" = '$(MADE_FOR)' ] && [ '$(filter FORCE,$^)' = '' ] \
	    && cat $(REQUIREMENTS) | cmp -s - $@; then touch $@; \
	else \
	    set -e; \
	    $(CHECK_PYTHON); \
	    $(CHECK_ROS_PYTHON); \
	    echo 'Making $(VENV): a minute or two, once.'; \
	    rm -rf $(VENV); \
	    $(PYTHON) -m venv $(VENV_OPTIONS) $(VENV); \
	    cat $(REQUIREMENTS) > $(VENV)/.requirements; \
	    for each in $(REQUIREMENTS); do grep -v '^$(WITHOUT)==' $$each > $(VENV)/$${each##*/}; done; \
	    grep -E '^($(NUMERICAL))==' $(VENV)/runtime.txt > $(VENV)/numerics.txt; \
	    $(INSTALL) -r $(VENV)/numerics.txt; \
	    echo '$(MADE_FOR)' > $(VENV)/.made-for; \
	    mv $(VENV)/.requirements $@; \
	fi

$(ENVIRONMENT): $(NUMERICS)
	@printf '$(VENV)/%s\n' $(notdir $(REQUIREMENTS)) | xargs -P 2 -n 1 $(INSTALL) -r
	@$(CHECK)
	@touch $@

# What only tests, linters and benchmarks need.
$(DEVELOPMENT): $(ENVIRONMENT) requirements/development.txt | $(PACKAGE)
	@rm -f $@
	@$(INSTALL) -r requirements/development.txt
	@$(CHECK)
	@touch $@

# Editable; needs no network. The build tools are in the lock. What the nodes import is compiled to
# bytecode here, as pip would, even where Python is told to write none: else it is at every start.
$(PACKAGE): $(ENVIRONMENT) setup.py setup.cfg
	@rm -f $@
	@$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	@PYTHONDONTWRITEBYTECODE= $(BIN)/python -c 'import cmpsp_ros.nodes.guidance.node, \
	    cmpsp_ros.nodes.sim.node, cmpsp_ros.nodes.recording.recorder, cmpsp_ros.demo.results'
	@touch $@

# What is compiled here the nodes load from the user's cache: they start at once, and without the
# memory that compiling takes. Of all this a demo needs what is for its preset.
$(KERNELS) $(DEMO_KERNELS): $(NUMERICS) $(SOURCES) $(wildcard $(PRESET))
	@$(BIN)/python -c 'from cmpsp_ros.warmup import main; main()' $(if $(filter $(DEMO_KERNELS),$@),$(PRESET))
	@touch $@
