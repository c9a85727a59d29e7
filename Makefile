# The commands of README.md. Each makes .venv and installs what it needs, then does so again only
# when pyproject.toml or constraints.txt has changed.

PYTHON ?= python3
FLIGHT ?= out/flight
REPRODUCTION ?= out/reproduction

bin := .venv/bin
# Python compiles what is imported; to compile all that is installed takes a minute.
pip_install := $(bin)/python -m pip install --quiet --no-compile --constraint constraints.txt
# The folder front_door is proxops; the others that hold an `__init__.py` are its subpackages.
folders := $(filter-out front_door,$(patsubst %/__init__.py,%,$(wildcard */__init__.py)))

# Editors see what is installed strictly, by links to each file. Files that are added are seen only by
# the import hook of the other mode, so that is the one for who works on proxops.
mode = $(if $(filter dev,$*)$(wildcard .venv/dev.stamp),,--config-settings editable_mode=strict)

export PIP_DISABLE_PIP_VERSION_CHECK = 1
# Else each process of the tests compiles all sources anew.
unexport PYTHONDONTWRITEBYTECODE

.DELETE_ON_ERROR:
.PHONY: help install fly lab test quick lint bench notebooks docs version note results train gym clean links

help:
	@echo "make fly        install, and fly one transit with the hybrid into $(FLIGHT)"
	@echo "make install    install proxops into .venv"
	@echo "make lab        install JupyterLab, without PyTorch, and open it with the notebooks"
	@echo "make test       run the tests (pytest -m slow and -m browser run the others)"
	@echo "make quick      run the tests of the rooms that were touched"
	@echo "make lint       check format, style and types"
	@echo "make bench      measure speed, beside other packages, into benchmarks/results.json"
	@echo "make notebooks  run every notebook, into build/notebooks"
	@echo "make docs       build the documentation into build/site; executes the notebooks: some minutes"
	@echo "make version    build the documentation beside that of other versions, on the branch gh-pages"
	@echo "make note       build the technical note, build/note.pdf"
	@echo "make results    take $(REPRODUCTION)/results.json into docs, and write its tables"
	@echo "make train      install what training needs (PyTorch)"
	@echo "make gym        install what learning on transits needs (Gymnasium, Minari, PyTorch)"
	@echo "make clean      remove .venv, build and caches"

install: .venv/core.stamp

fly: .venv/core.stamp
	@echo "flying one transit; the first flight on a machine compiles first, which takes a minute"
	$(bin)/proxops fly --controller hybrid --out $(FLIGHT)

lab: .venv/lab.stamp
	$(bin)/jupyter lab notebooks

test: .venv/dev.stamp
	$(bin)/pytest --numprocesses auto --dist worksteal

# What covers the rooms that were touched, or those of `make quick TESTS="tests/systems/lidar …"`.
quick: TESTS ?= $(shell $(bin)/python .ci/touched.py)
quick: .venv/dev.stamp
	@[ -n "$(TESTS)" ] || echo "nothing that was touched has tests of its own: make test"
	[ -z "$(TESTS)" ] || $(bin)/pytest --numprocesses auto --dist worksteal $(TESTS)

# Tools that read sources can't follow the import hook of an editable installation. In build/rooms
# the folders are packages by themselves, as import-linter needs them.
links:
	@rm -rf build/links build/rooms && mkdir -p build/links/proxops build/rooms/proxops
	@for folder in $(folders); do for place in links rooms; do \
	    ln -s ../../../$$folder build/$$place/proxops/$$folder; done; done
	@ln -s ../../../front_door/__init__.py build/links/proxops/__init__.py

lint: .venv/dev.stamp links
	@cd $$($(bin)/python -c "import sysconfig; print(sysconfig.get_path('purelib'))") && \
	    { find pydrake -name '*.pyi'; echo pydrake/systems/scalar_conversion.pyi; } | \
	    while read -r stub; do \
	        mkdir -p "$(CURDIR)/build/stubs/$${stub%/*}"; \
	        printf '%s\n' 'from typing import Any' 'def __getattr__(name: str) -> Any: ...' \
	            > "$(CURDIR)/build/stubs/$$stub"; \
	    done
	$(bin)/ruff format --check
	$(bin)/ruff check
	PYTHONPATH=.ci:build/rooms $(bin)/lint-imports --no-cache --no-logo
	$(bin)/pyright --threads build/links/proxops/* tests

# The other benchmarks fly campaigns. Each says how it is run.
bench: export PROXOPS_BENCH_RESULTS := benchmarks/results.json
bench: .venv/dev.stamp .venv/bench.stamp
	$(bin)/python benchmarks/gravity.py
	$(bin)/python benchmarks/lidar.py
	for gravity in exact table; do \
	    $(bin)/python benchmarks/mpc_step.py --gravity $$gravity && \
	    $(bin)/python benchmarks/flight.py --transits 10 --gravity $$gravity || exit 1; done
	$(bin)/python benchmarks/navigation.py --only step --transits 2
	$(bin)/python benchmarks/flight.py --batch 512

# One on each core; threads of numerical libraries would only be in one another's way.
executed := $(patsubst %,build/%,$(wildcard notebooks/*.ipynb))
notebooks: .venv/notebook.stamp
	@$(MAKE) --no-print-directory --jobs "$$(getconf _NPROCESSORS_ONLN)" $(executed)

build/notebooks/%.ipynb: notebooks/%.ipynb $(wildcard */*/*.py) | .venv/notebook.stamp
	@OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(bin)/jupyter nbconvert --log-level WARN \
	    --to notebook --execute --output-dir build/notebooks $<

# The variable silences an advertisement.
docs: .venv/docs.stamp links notebooks
	@NO_MKDOCS_2_WARNING=1 $(bin)/mkdocs build --quiet --strict
	@echo "open build/site/index.html"

# A page of this branch shows a list of versions. Versions that differ in fixes alone are one.
version: docs
	@PATH="$(CURDIR)/$(bin):$$PATH" NO_MKDOCS_2_WARNING=1 $(bin)/mike --quiet deploy --update-aliases \
	    "$$($(bin)/proxops --version | grep -o '[0-9]*\.[0-9]*' | head -n 1)" latest
	@$(bin)/mike --quiet set-default latest

note: .venv/note.stamp
	$(bin)/python docs/note/build.py

results: .venv/core.stamp
	$(bin)/python docs/render_results.py $(REPRODUCTION)

train: .venv/train.stamp

gym: .venv/gym.stamp .venv/train.stamp

clean:
	rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +

.venv/bin/pip:
	$(PYTHON) -m venv .venv

.venv/core.stamp: pyproject.toml constraints.txt | .venv/bin/pip
	@echo "installing proxops and what it needs into .venv (1 GB)"
	$(pip_install) $(mode) --editable .
	@touch $@

.venv/%.stamp: pyproject.toml constraints.txt | .venv/bin/pip
	$(pip_install) $(mode) --editable '.[$*]'
	@touch .venv/core.stamp $@
