# Two commands set up everything they need in .venv: `make demo` and `make test`.
# Wanted on the machine: Python >= 3.11 (with venv), a C compiler, make.

PYTHON ?= python3
BIN := .venv/bin
# Its caches stay in the checkout, and it asks nothing of the network.
DENO := DENO_DIR=build/deno DENO_NO_UPDATE_CHECK=1 $(BIN)/deno
# The matrices here are tiny; threads would only wait for each other.
export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test bench docs lint format clean

demo: .venv/ready
	$(BIN)/foreswitch demo --out demo

test: .venv/ready
	$(BIN)/python -m pytest -n auto

bench: .venv/ready
	$(BIN)/pip install -q -c constraints.txt -e .[bench] --no-build-isolation
	$(BIN)/python benchmarks/run.py

docs: .venv/ready
	$(BIN)/pip install -q -c constraints.txt -e .[docs] --no-build-isolation
	$(BIN)/python -m sphinx -q -W --keep-going docs docs/_build/html

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/clang-format --dry-run -Werror core/*.[ch] core/*/*.[ch] src/binding/*.[ch]
	$(DENO) lint
	$(DENO) fmt --check
	$(DENO) check -q src/foreswitch/page/static/*.js

format: .venv/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i core/*.[ch] core/*/*.[ch] src/binding/*.[ch]
	$(DENO) lint --fix
	$(DENO) fmt

# Python changes are live; a change of C or of the metadata reinstalls.
.venv/ready: pyproject.toml constraints.txt CMakeLists.txt $(wildcard examples/*/*.toml examples/*/*.csv) LICENSE $(wildcard core/*.[ch] core/*/*.[ch] src/binding/*.[ch])
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/pip install -q -c constraints.txt "scikit-build-core>=0.10" "cmake>=3.26" ninja
	$(BIN)/pip install -q -c constraints.txt --no-build-isolation -e .[dev]
	touch $@

clean:
	rm -rf .venv build demo docs/_build docs/_generated
