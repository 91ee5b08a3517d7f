# make        set up, then the main job: generate the reference robot and verify it
# make test   set up, then lint, types and all tests
# make help   every target
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
CORE := $(VENV)/.core
READY := $(VENV)/.ready
READY_CORE := $(VENV)/.ready-core
# syntax trees, protocols, pickling, numbers and texts of the standard library change from one Python to the next; what
# compilers and other libraries say does not
PYTHON_TESTS := tests/base/yamltext tests/program tests/robot/importers/test_xml.py \
	$(patsubst %,tests/robot/file/test_%.py,joints links properties quantities reader schema suggestions units writer) \
	tests/emit/test_manifest.py tests/emit/test_writer.py tests/runtime/test_model.py \
	tests/runtime/test_derived_model.py tests/cli/test_main.py tests/emit/test_language.py \
	tests/emit/test_function.py tests/test_imports.py

# --dist worksteal: a file stays with one worker while there are others, so that its fixtures are set up once;
# tests start many processes, which would compile every module anew where the environment forbids to keep byte code
unit python sweep: export PYTHONDONTWRITEBYTECODE :=
# one thread of linear algebra in each test process: more of them wait for each other, and a quarter of the time is lost
unit python sweep: export OPENBLAS_NUM_THREADS := 1
unit python sweep: export OMP_NUM_THREADS := 1

.DEFAULT_GOAL := rrr
.PHONY: playground rrr core setup test lint types unit python sweep generated update stubs bench docs pages stranger mutants fuzz machines clean help
SEEDS ?= 12
SEED ?= 1
SECONDS_EACH ?= 600

rrr: core  ## generate the RRR robot into runs/rrr, run its self-test, verify it against independent dynamics
	$(BIN)/rrrgen generate rrr -o runs/rrr
	$(CC) -std=c99 -O2 runs/rrr/*.c -lm -o runs/rrr_selftest && runs/rrr_selftest
	$(BIN)/rrrgen verify rrr

core: $(CORE)  ## the virtual environment with rrrgen and no extras, enough for the main job

$(CORE): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet -e .
	touch $@

setup: $(READY)  ## the same with everything that the tests need, about 2 GB

$(READY): $(CORE)
	$(BIN)/python -m pip install --quiet --no-compile -e ".[test]"
	touch $@

$(READY_CORE): $(CORE)
	$(BIN)/python -m pip install --quiet --no-compile -e ".[test-core]"
	touch $@

test: setup lint types unit generated  ## everything that continuous integration runs

lint: setup  ## style
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup  ## static types
	$(BIN)/mypy

unit: setup  ## the tests, on all processors
	$(BIN)/python -m pytest -q -n auto --dist worksteal

python: $(READY_CORE)  ## the tests of what depends on the version of Python; continuous integration runs them on the oldest and the newest
	$(BIN)/python -m pytest -q -n auto --dist worksteal $(PYTHON_TESTS)

sweep: setup  ## ten times the random draws, fresh ones of Hypothesis, more robots, compilers and damaged files; hours
	RRRGEN_DRAWS=10 RRRGEN_FUZZ=300 HYPOTHESIS_PROFILE=explore $(BIN)/python -m pytest -q -n auto --dist worksteal \
		tests/damage $$(grep -rlE '@given|draws\(|mark\.sweep' tests --include='test_*.py')

generated: core  ## the committed code of the reference robot is what the generator writes today
	$(BIN)/rrrgen generate rrr -o generated/rrr --check

PYODIDE ?= 314.0.7
playground: core  ## the page that runs the compiler in a browser, into build/playground; fetches its runtime through npm
	npm install --prefix build/npm --no-save --no-audit --no-fund pyodide@$(PYODIDE) playwright-core
	$(BIN)/rrrgen playground build/playground --build build/npm/node_modules/pyodide

update: setup  ## write the committed code of the reference robot anew
	$(BIN)/rrrgen generate rrr -o generated/rrr --no-casadi-files

stubs: setup  ## write the stub of the methods that are made from the table of model functions
	$(BIN)/python -m rrrgen.runtime.functions.methods > rrrgen/runtime/functions/table_functions.pyi.new
	mv rrrgen/runtime/functions/table_functions.pyi.new rrrgen/runtime/functions/table_functions.pyi

bench: setup  ## measure emitted C side by side with other packages; the page and the plots go to docs/
	$(BIN)/python -m pip install --quiet -e ".[bench]"
	$(BIN)/python -m bench -o bench/results
	cp bench/results/benchmark.md bench/results/benchmark.svg bench/results/benchmark.png docs/

docs: core  ## the documentation as web pages, in docs/_build/html
	$(BIN)/python -m pip install --quiet -e ".[docs]"
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html

pages: setup  ## every command that the pages and the help texts print, as printed; it takes some minutes
	$(BIN)/python tests/pages/every_command.py

stranger:  ## SEEDS=12 robots that nobody has tried, each from a wheel all the way to an identified model; then the pages
	$(PYTHON) tests/stranger.py --seeds $(SEEDS) --pages

mutants: setup  ## 30 changes of one operator, number or condition: do the tests notice? SEED=1 is the fixed sample
	$(BIN)/python tests/mutants.py --seed $(SEED)

fuzz: setup  ## damaged files for all readers, hostile numbers for emitted C under sanitizers; SECONDS_EACH=600
	$(BIN)/python tests/fuzz.py --seconds $(SECONDS_EACH)

machines: setup  ## the self-tests of all robots on other processors (QEMU, Node), as far as their tools are installed
	$(BIN)/python -m bench.machines

clean:  ## remove what the targets above made
	rm -rf $(VENV) runs/rrr runs/rrr_selftest docs/_build

help:  ## this list
	@sed -n 's/^\([a-z]*\):[^#]*## \(.*\)/\1\t\2/p' $(MAKEFILE_LIST) | expand -t 12
