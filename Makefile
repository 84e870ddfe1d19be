# Needs make and Python 3.11 or newer, nothing else: every target that runs Python makes .venv first if there is none.
# Another interpreter: make PYTHON=python3.12 test

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.installed
DOCS := .venv-docs
GALLERY ?= 1
FIGURES ?= thesis/ why_the_parabola_fails nets
SOURCES := $(wildcard dmis benchmarks docs examples scenes tests)

.DEFAULT_GOAL := help
.PHONY: help setup demo figures publish tables test test-examples test-slow bench bench-kernels check format docs clean

help:  ## print this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-15s %s\n", $$1, $$2 }' Makefile

setup: $(READY)  ## make .venv and install dmis in it (editable, with all extras and the tools)

# The stamp is written last, so that an interrupted set-up is done again; pip only adds what pyproject.toml has come to ask for.
$(READY): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "dmis needs Python 3.11 or newer; $(PYTHON) is " + sys.version.split()[0] + ". Name another one: make PYTHON=python3.12 setup")'
	@echo "Setting up $(VENV), once: dmis, its extras and the tools of developers are downloaded and installed (minutes)"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[all,dev]"
	@touch $(READY)

demo: $(READY)  ## render the teapot by three rules in the same time, print the table, draw the picture
	$(BIN)/python examples/demo.py

figures: $(READY)  ## draw the figures of the thesis for figures/index.html and docs/figures (15 minutes); FIGURES=/: all, hours
	$(BIN)/python examples/make_figures.py --publish docs --only $(FIGURES)

publish: $(READY)  ## make tables and pictures of the pages that are older than what decides them (hours; continues); QUICK=1: repeat the results by three seeds (half an hour)
	$(BIN)/python benchmarks/$(if $(QUICK),repeat,publish).py

tables: $(READY)  ## list the tables and pictures of the pages, and why some of them are old
	$(BIN)/python benchmarks/publish.py --list

test: $(READY)  ## run the tests of the package (minutes)
	$(BIN)/python -m pytest --numprocesses=auto --maxprocesses=8 --dist=worksteal

test-examples: $(READY)  ## run the code of examples/ and docs/, small: figures, measurements, pages, lessons (minutes)
	$(BIN)/python -m pytest --numprocesses=auto --maxprocesses=8 --dist=worksteal -m "examples and not slow"

test-slow: $(READY)  ## run the slow tests: converged images and statistics of whole renders
	$(BIN)/python -m pytest -m slow

bench: $(READY)  ## measure speed against the same Embree calls alone, and whether the targets are met (minutes)
	$(BIN)/python benchmarks/speed.py

bench-kernels: $(READY)  ## measure lobes, lights, warps, textures and the film one by one
	$(BIN)/python -m pytest benchmarks/test_kernels.py --benchmark-columns=min,median,iqr

check: $(READY)  ## lint, format, types and sizes, without changing a file
	$(BIN)/python -m ruff check $(SOURCES)
	$(BIN)/python -m ruff format --check $(SOURCES)
	$(BIN)/python -m mypy
	$(BIN)/python -m pytest -q tests/test_size.py tests/test_published.py

format: $(READY)  ## rewrite the sources in the project's format
	$(BIN)/python -m ruff check --fix $(SOURCES)
	$(BIN)/python -m ruff format $(SOURCES)

# The documentation has an environment of its own: what builds it is pinned, and need not agree with anything else.
$(DOCS)/.installed: pyproject.toml
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/python -m pip install --quiet --disable-pip-version-check -e ".[docs]"
	@touch $(DOCS)/.installed

docs: $(DOCS)/.installed  ## build the site into docs/_build/html and run its tutorials (minutes); GALLERY=0: without their pictures
	$(DOCS)/bin/python -m sphinx -E -q -W --keep-going -D sphinx_gallery_conf.plot_gallery=$(GALLERY) docs docs/_build/html
	@echo docs/_build/html/index.html

clean:  ## remove .venv, caches and everything that was built
	rm -rf $(VENV) $(DOCS) docs/_build docs/generated build dist .mypy_cache .pytest_cache .ruff_cache
	find $(SOURCES) -name __pycache__ -type d -prune -exec rm -rf {} +
