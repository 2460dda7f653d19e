# One way in for people, hooks and CI. `make` alone lists the targets.
#
# Everything runs in .venv, which is made on first use: by uv where it is installed, else by venv and pip. make demo
# installs what a user would; all else installs the very versions of requirements-dev.lock, from whatever package index
# the machine is set up for.

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
# What a user would install is enough for the demo alone. Where more is there already, or is asked for in the same
# breath, that serves as well, and no two installers meet in one environment (make -j demo test).
USABLE := $(if $(wildcard $(INSTALLED))$(filter-out demo,$(MAKECMDGOALS)),$(INSTALLED),$(VENV)/.usable)
DEMO := demo
SECONDS ?= 60
EXTRACT := calibrary extract flight --recursive --output-matrix result/K_matrix.npy
# Two test processes on two cores leave OpenBLAS's threads nothing to do but spin.
export OPENBLAS_NUM_THREADS ?= 1
# Bytecode is built, so it is kept with all else that is; where none is kept, each process compiles for seconds.
export PYTHONPYCACHEPREFIX ?= $(CURDIR)/build/bytecode
unexport PYTHONDONTWRITEBYTECODE
UV := $(shell command -v uv 2>/dev/null)

ifdef UV
PYTHON ?= >=3.11
MAKE_VENV = $(UV) venv --quiet --allow-existing --python '$(PYTHON)' $(VENV)
ENSURE_INSTALLER = :
INSTALL = $(UV) pip install --quiet --python $(BIN)/python
else
PYTHON ?= python3
MAKE_VENV = $(PYTHON) -c '$(REQUIRE_3_11)' && $(PYTHON) -m venv $(VENV)
ENSURE_INSTALLER = $(BIN)/python -m pip --version >/dev/null 2>&1 || $(BIN)/python -m ensurepip >/dev/null
INSTALL = $(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check
endif

# Every Python back to 2 can read this, so the one that is too old says so itself.
REQUIRE_3_11 := import sys; sys.version_info >= (3, 11) or sys.exit("calibrary needs Python 3.11 or newer; %s is \
%d.%d. Name a newer one (make PYTHON=python3.12), after removing $(VENV) if it is there." \
% ((sys.executable,) + tuple(sys.version_info[:2])))

.PHONY: help demo test test-floors test-thorough lint format golden size bench fuzz mutants schemas docs man pictures dist lock clean
.DEFAULT_GOAL := help

help: ## List what can be made
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-13s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

demo: $(USABLE) ## Synthesise the flight of a mixed fleet and judge it
	@rm -rf $(DEMO)
	$(BIN)/calibrary demo $(DEMO)
	@printf '\n%s\n\n' 'cd $(DEMO); $(EXTRACT)'
	@status=0; (cd $(DEMO) && $(CURDIR)/$(BIN)/$(EXTRACT)) || status=$$?; \
	if [ $$status -ne 1 ]; then \
		echo "make demo: extract ended with exit code $$status, wanted 1: the flight holds bad images" >&2; \
		exit 1; \
	fi
	@echo
	@echo 'Exit code 1, as it should be: some images of this flight are bad on purpose, and no K was made up for them.'
	@echo 'The matrices and the report are in $(DEMO)/result. The commands of README.md can be typed there:'
	@echo '  source $(BIN)/activate; cd $(DEMO)'

test: $(INSTALLED) ## Run the test suite on all processors (ARGS="-k name -n 0" narrows it, on one)
	$(BIN)/pytest -n auto --dist worksteal $(ARGS)

test-thorough: $(INSTALLED) ## Run all tests, browsers and long solves too, with many more, and ever new, examples
	HYPOTHESIS_PROFILE=thorough $(BIN)/pytest -n auto --dist worksteal $(ARGS)

# The oldest libraries meet the newest of what these need themselves, and are told that their ways are dated. What is
# kept of the commands' outputs is that of the locked ones.
test-floors: $(INSTALLED) ## Run the suite with the oldest libraries that pyproject.toml allows, in .venv-floors
	@$(if $(UV),:,echo "make test-floors needs uv" >&2; exit 1)
	@mkdir -p build
	@$(UV) pip compile --quiet --resolution lowest-direct --python-version 3.11 --all-extras --output-file build/floors.txt pyproject.toml
	@$(UV) venv --quiet --allow-existing --python 3.11 .venv-floors
	@$(UV) pip install --quiet --python .venv-floors/bin/python -r requirements-dev.lock
	@# pandas, which only tests read tables with, is the newest that takes the oldest NumPy.
	@$(UV) pip install --quiet --python .venv-floors/bin/python -r build/floors.txt pandas
	@$(UV) pip install --quiet --python .venv-floors/bin/python --no-deps --no-build-isolation -e .
	@# ExifRead 3.3 installs its own tests as a package of that name, which hides ours from processes that tests start.
	@rm -rf .venv-floors/lib/python3.11/site-packages/tests
	.venv-floors/bin/pytest -W ignore::DeprecationWarning -n auto --dist worksteal --deselect tests/house --deselect tests/cli/test_outputs.py $(ARGS)

lint: $(INSTALLED) ## Check style, format, types and the layers of imports
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

format: $(INSTALLED) ## Put the code into the project's format
	$(BIN)/ruff check --fix-only
	$(BIN)/ruff format

golden: $(INSTALLED) ## Keep all that the commands print and write now as what they should; git diff shows what that changes
	GOLDEN=accept $(BIN)/pytest -q -n 0 tests/cli/test_outputs.py

size: $(INSTALLED) ## Print how large each room is, beside its budget (ARGS=--lower lowers the budget to what is needed)
	$(BIN)/python -m tests.house.size $(ARGS)

bench: $(INSTALLED) ## Run every benchmark in its quick form and write docs/performance.md (ARGS="extract startup" prints these)
	$(BIN)/python -m benchmarks.run $(ARGS)

# atheris has wheels for Linux alone, so it is installed here, on demand, and never beside the tests' own tools.
fuzz: $(INSTALLED) ## Fuzz every reader (SECONDS=60 each, FORMAT=a,b these alone)
	@$(BIN)/python -c 'import atheris' 2>/dev/null || $(INSTALL) --only-binary atheris 'atheris>=3.0,<4' || { \
		echo "make fuzz: atheris has no wheel for this Python or system; it has for Linux" >&2; exit 1; }
	$(BIN)/python -m fuzz.run --seconds $(SECONDS) $(if $(FORMAT),--target $(FORMAT))

# coverage.py is installed here, on demand: it only chooses the tests of a mutant.
mutants: $(INSTALLED) ## Change operators of the product at random and see whether a test notices (ARGS="registry --count 200")
	@$(BIN)/python -c 'import coverage' 2>/dev/null || $(INSTALL) 'coverage>=7.6,<8'
	$(BIN)/python -m benchmarks.mutants $(ARGS)

schemas: $(INSTALLED) ## Write the JSON Schemas of schemas/ from the records they are of
	$(BIN)/python docs/make_schemas.py

docs: $(INSTALLED) ## Build the manual into build/manual, without network; a warning is an error
	$(BIN)/python docs/make_formats.py
	$(BIN)/python -m sphinx -q -W --keep-going -j auto -b html -d build/doctrees docs build/manual
	@echo 'The manual is build/manual/index.html.'

man: $(INSTALLED) ## Write a man page of each command into build/man
	$(BIN)/python -m sphinx -q -W --keep-going -b man -d build/doctrees docs build/man

pictures: $(INSTALLED) ## Draw the pictures of the documentation from real output
	$(BIN)/python docs/make_pictures.py --pages

dist: $(INSTALLED) ## Build sdist and wheel into dist/ and check what is in them
	rm -rf dist
	CALIBRARY_KERNEL=0 $(BIN)/python -m hatchling build -d dist
	CALIBRARY_DIST=dist $(BIN)/pytest tests/house/test_distribution.py

lock: ## Resolve requirements-dev.lock anew with uv (ARGS=--upgrade takes the newest)
	@$(if $(UV),:,echo "make lock needs uv" >&2; exit 1)
	$(UV) pip compile --quiet --universal --python-version 3.11 --all-extras --group dev --generate-hashes \
		--custom-compile-command "make lock" $(ARGS) --output-file requirements-dev.lock pyproject.toml

clean: ## Remove everything that was made, but for .venv
	rm -rf build dist $(DEMO) bench-corpus .coverage
	rm -rf .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find . -path ./$(VENV) -prune -o -type d -name __pycache__ -exec rm -rf {} +

$(INSTALLED): pyproject.toml requirements-dev.lock src/calibrary/kernel/_kernel.c | $(BIN)/python
	@$(BIN)/python -c '$(REQUIRE_3_11)'
	@echo "Installing what development needs into $(VENV) …"
	@$(ENSURE_INSTALLER)
	@$(INSTALL) -r requirements-dev.lock
	@$(INSTALL) --no-deps --no-build-isolation -e .
	@touch $@

$(VENV)/.usable: pyproject.toml | $(BIN)/python
	@$(BIN)/python -c '$(REQUIRE_3_11)'
	@echo "Installing calibrary into $(VENV) …"
	@$(ENSURE_INSTALLER)
	@$(INSTALL) -e '.[calibrate,pages]'
	@touch $@

$(BIN)/python:
	@$(MAKE_VENV)
