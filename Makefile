# make demo            the shipped skirt on its sample motion, then a small skirt learnt without any data
# make test            set up .venv, check style and types, run all tests
# make skirt DATA=DIR  the whole way: import, train, roll out, evaluate, render
# make judge MODEL=DIR  the last three of these, for any trained model
# make docs-check      run the commands of README and docs, on small files
# make check-speed     ratios of times within one run against their bounds, on an idle machine
# make setup lint format lock clean viewer
# PYTHON=python3.12 selects the interpreter that .venv is made with.

PYTHON ?= python3
VENV ?= .venv
RUN ?= runs/skirt
IMPORTED ?= data/skirt
AGAIN ?= $(IMPORTED)_again
WORKERS ?= 2
DEMO ?= runs/demo
MINUTES ?= 4
BIN := $(VENV)/bin
TESTS := tests
# Also run with XLA's optimisations, as users do; all tests run without them (tests/conftest.py says why).
OPTIMISED := tests/geometry/test_bitset.py tests/geometry/test_self_crossings.py tests/postprocess/collision/test_contacts.py
PREDICTIONS = $(RUN)/test
MODEL ?= models/skirt

.PHONY: demo test skirt judge docs-check check-speed setup lint format lock clean viewer

# The first target: what `make` alone does. Interrupted at any point, it goes on where it was.
demo: setup
	mkdir -p $(DEMO)
	$(BIN)/garment-jax animate skirt --out $(DEMO)/skirt.html --no-open --force
	$(BIN)/garment-jax learn skirt --minutes $(MINUTES) --workers $(WORKERS) --out $(DEMO)/model

test: lint
	@failed=0; \
	JAX_DISABLE_MOST_OPTIMIZATIONS=0 $(BIN)/python -m pytest $(OPTIMISED) || failed=$$?; \
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal $(TESTS) || failed=$$?; \
	exit $$failed

setup: $(VENV)/ready

# Every package with its hash from the lock; then the checkout itself, editable, built without the network.
$(VENV)/ready: requirements.lock pyproject.toml setup.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "error: $(PYTHON) is older than 3.11 or not there; name another: make setup PYTHON=python3.12" >&2; \
	  exit 2; }
	$(PYTHON) -m venv --clear $(VENV)  # what an interrupted setup left would stop pip
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

lint: setup
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/pyright --pythonpath $(BIN)/python

format: setup
	@$(BIN)/ruff check --fix
	@$(BIN)/ruff format

# One file for Python 3.11 and newer, without any mirror's address; needs uv.
lock:
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate \
	  --custom-compile-command 'make lock' --no-emit-index-url \
	  --extra test --extra dev --extra tensorboard --extra sim --extra usd --extra onnx --extra unwrap --extra farm \
	  pyproject.toml -o requirements.lock

# Interrupted at any point, the same command goes on where it was.
skirt: setup
	@test -n "$(DATA)" || { echo "make skirt needs the folder of clips: make skirt DATA=DIR" >&2; exit 2; }
	$(BIN)/garment-jax import $(DATA) --out $(IMPORTED)
	test -z "$(DATA_AGAIN)" || $(BIN)/garment-jax import $(DATA_AGAIN) --out $(AGAIN)
	$(BIN)/python train.py configs/skirt.toml --data $(IMPORTED) --run-dir $(RUN)
	@$(MAKE) --no-print-directory judge MODEL=$(RUN)

# Animate, evaluate and render the test clips with any run or model: make judge MODEL=models/skirt
judge: setup
	mkdir -p $(PREDICTIONS)
	set -e; for clip in $(IMPORTED)/test/*.h5; do \
	  $(BIN)/python infer.py $(MODEL) --motion $$clip --out $(PREDICTIONS)/$$(basename $$clip) --force; \
	done
	$(BIN)/garment-jax evaluate $(PREDICTIONS) $(IMPORTED)/test --every 10 --out $(RUN)/figures.json --force \
	  $(if $(wildcard $(AGAIN)/test),--again $(AGAIN)/test --curves $(RUN)/curves.png)
	$(BIN)/garment-jax render $(PREDICTIONS) $(IMPORTED)/test --out $(RUN)/pictures --force

docs-check: setup
	$(BIN)/python -m tests.docs_check.run

check-speed: setup
	$(BIN)/python benchmarks/regressions.py

clean:
	rm -rf $(VENV) .cache build

# The part of three.js that `garment-jax view` puts into its pages, anew; needs npm, nothing else here does.
viewer:
	cd garment_jax/viewer/bundle && npm install --no-package-lock && npm run build
