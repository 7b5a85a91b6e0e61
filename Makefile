# `make run` scores the baseline arms, `make test` runs the tests; each sets up what it needs in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: run test lint format same clean clean-cache

$(VENV)/run.stamp: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) -e .
	touch $@

$(VENV)/dev.stamp: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) torch -e '.[train,view,dev]'
	touch $@ $(VENV)/run.stamp

# numba's disk cache does not notice a changed callee in another file: start it anew when a source has changed
$(VENV)/kernels.stamp: $(VENV)/run.stamp $(shell find controllers envs -name '*.py')
	$(MAKE) --no-print-directory clean-cache
	$(BIN)/push-recovery bench --seconds 1 --json > /dev/null
	touch $@

run: $(VENV)/kernels.stamp
	$(BIN)/push-recovery evaluate --suite quick

test: $(VENV)/dev.stamp $(VENV)/kernels.stamp
	$(BIN)/python -m pytest -n 2 tests

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

# rows of quick and hard and the numbers of reproduce against another commit's, bit for bit
REF ?= 7bb5027
same: $(VENV)/run.stamp
	$(BIN)/python benchmarks/same_rows.py $(REF)

format: $(VENV)/dev.stamp
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) build runs *.egg-info

clean-cache:
	find controllers envs eval training -name '*.nb[ci]' -delete
