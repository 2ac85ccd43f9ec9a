# All targets but ament need only Python 3.10 to 3.13 with venv: no ROS, no root.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INDEX := $(VENV)/share/ament_index/resource_index/packages
MADE := $(VENV)/.made-from-setup.py
DOCS_TOOLS := $(VENV)/.docs-tools-from-setup.py

# The ament index of the ROS wheels in the environment. A sourced ROS must not interfere.
export AMENT_PREFIX_PATH := $(CURDIR)/$(VENV)
unexport PYTHONPATH LD_LIBRARY_PATH RMW_IMPLEMENTATION
# The tests start some two hundred processes, which would compile the same modules each.
unexport PYTHONDONTWRITEBYTECODE

# Logs, compiled kernels and caches need a home directory that can be written to.
ifneq ($(shell test -n "$$HOME" && test -w "$$HOME" && echo writable),writable)
export HOME := $(CURDIR)/$(VENV)/home
endif

# ROS wheels exist for these versions of Python.
define CHECK_PYTHON
import sys
if not (3, 10) <= sys.version_info[:2] <= (3, 13):
    sys.exit('expected Python 3.10 to 3.13, got %d.%d: make PYTHON=python3.12' % sys.version_info[:2])
endef
export CHECK_PYTHON

.PHONY: help venv links demo test exhaustive lint docs ament colcon opencv46 clean
help:
	@echo 'make venv      create the environment $(VENV): this package (editable), ROS 2 wheels, tools'
	@echo 'make demo      run a simulated camera, detector and pose node over DDS; writes demo.png'
	@echo 'make test      run unit, property and DDS tests'
	@echo 'make exhaustive  run the tests that take longer: many cameras, extreme numbers, no JIT'
	@echo 'make lint      check style and types'
	@echo 'make docs      build the documentation, build/docs/index.html, and run the notebook'
	@echo 'make ament     check package.xml against its schema (needs a sourced ROS, or apt)'
	@echo 'make colcon    build, start and test in a colcon workspace'
	@echo 'make opencv46  run the image tests with OpenCV 4.6, the oldest supported version'
	@echo 'make clean     remove everything that these targets create'

venv: $(MADE)

# An editable install omits data files; the links make the environment a complete ament prefix.
$(MADE): setup.py
	@$(PYTHON) -c "$$CHECK_PYTHON"
	@echo 'Creating the environment $(VENV), once; it takes a minute or two.'
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --disable-pip-version-check --editable '.[ros,test,lint]' || \
		{ echo 'make: pip failed, see above. Without a network it cannot download.' >&2; exit 1; }
	@$(MAKE) --no-print-directory links
	@$(BIN)/p4pfr compile
	@touch $@

# The path may contain spaces: a quoted folder, and names relative to it.
links:
	@mkdir -p $(VENV)/lib/p4pfr_ros $(VENV)/share/p4pfr_ros $(INDEX)
	@ln -sfn "$(CURDIR)/resource/p4pfr_ros" $(INDEX)/
	@for name in package.xml config launch; do \
		ln -sfn "$(CURDIR)/$$name" $(VENV)/share/p4pfr_ros/; done
	@for name in scripts/*; do ln -sfn "$(CURDIR)/$$name" $(VENV)/lib/p4pfr_ros/; done

demo: venv
	$(BIN)/p4pfr demo

# Interpreted kernels give the same results: shown for one module of each kind, as it takes long.
INTERPRETED := test/core/minimal test/core/model test/core/cameras test/core/test_linalg.py \
	test/core/test_jit.py test/core/one_view/test_least_squares.py \
	test/core/one_view/test_known_camera.py test/core/one_view/test_estimate_pose.py \
	test/core/many_views/test_bundle_adjustment.py

# DDS tests run last and alone, because their processes need the cores. They mostly wait, so three
# modules run at a time, each in its own DDS domain.
test: venv
	$(BIN)/p4pfr compile
	$(BIN)/python -m pytest -m 'not dds and not exhaustive' -n auto --dist loadscope
	$(BIN)/python -m pytest -m 'dds and not exhaustive' -n 3 --dist loadscope

# Kernels are compiled once instead of by each worker.
exhaustive: venv
	$(BIN)/p4pfr compile
	NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -m 'not exhaustive' -n auto $(INTERPRETED)
	$(BIN)/python -m pytest -m exhaustive -n auto --dist loadscope

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/ament_flake8 --config setup.cfg p4pfr_ros benchmarks docs examples test launch setup.py
	$(BIN)/ament_pep257 --add-ignore D401 D402 -- p4pfr_ros benchmarks docs examples launch setup.py

# Warnings are errors: a broken link, a page that no table of contents lists.
docs: $(DOCS_TOOLS)
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet docs build/docs
	$(BIN)/jupyter-execute --kernel_name python3 notebooks/quickstart.ipynb
	$(BIN)/check-jsonschema --builtin-schema vendor.citation-file-format CITATION.cff
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-config .github/ISSUE_TEMPLATE/config.yml
	$(BIN)/check-jsonschema --builtin-schema vendor.github-issue-forms \
		$(filter-out %/config.yml, $(wildcard .github/ISSUE_TEMPLATE/*.yml))
	@echo 'open build/docs/index.html'

$(DOCS_TOOLS): $(MADE)
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@

ament:
	.ci/ament

colcon:
	PYTHON='$(PYTHON)' .ci/colcon

opencv46:
	PYTHON='$(PYTHON)' .ci/opencv46

clean:
	rm -rf $(VENV) .venv-colcon .venv-opencv46 .colcon build dist *.egg-info demo.png
	rm -rf docs/api/generated docs/project
	rm -rf p4pfr_ros/_kernels .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
