# `make run` scores variants and learned policies, `make test` runs the tests; each sets up what it needs in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.PHONY: run contenders policies tables leaderboard docs test test-newest test-oldest lint format same mutants clean

$(VENV)/run.stamp: pyproject.toml constraints.txt
	@echo "sets up $(VENV), once: about a minute"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(PIP) -e '.[play,report]'
	touch $@

$(VENV)/dev.stamp: pyproject.toml constraints.txt
	@echo "sets up $(VENV), once: some minutes"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(PIP) torch -e '.[train,view,play,report,docs,dev]'
	touch $@ $(VENV)/run.stamp

# place and time of the step, the trunk with them, all of it, all of it corrected by a network, and a network alone
POLICIES := stage-1 stage-1+momentum two-stage residual residual-hardware joint-residual joint-residual-hardware joint
run: $(VENV)/run.stamp
	$(BIN)/push-recovery evaluate --suite quick --profile exact hardware --policies $(POLICIES)

# policies of others beside every variant of the planner, on 48 pushes each of three suites, on two robots
PLANNERS := two-stage stage-1+cop stage-1+momentum stage-1 raibert herdt fixed-time
THREE := --suite hard standing kick --sample 48 --policies
contenders: $(VENV)/run.stamp
	@$(PIP) -e '.[play,report,contenders,robots]'
	@$(PIP) --no-deps holosoma-inference
	$(BIN)/push-recovery evaluate --env PushRecovery/G1-v0 $(THREE) $(PLANNERS) \
	  joint-residual-g1 joint-g1 residual-g1 holosoma-g1-fastsac holosoma-g1-ppo
	$(BIN)/push-recovery evaluate --env PushRecovery/T1-v0 $(THREE) $(PLANNERS) \
	  joint-residual-t1 holosoma-t1-fastsac holosoma-t1-ppo

test: $(VENV)/dev.stamp
	$(BIN)/python -m pytest -n 2 tests

# trains the policies that come with the package again, in runs/policies; a run that is ended goes on where it was
policies: $(VENV)/dev.stamp
	$(BIN)/push-recovery policies

# The rows of the headline table and the tests of control and environments with a plain `pip install`, in an
# environment of its own: with the newest versions that pip finds, and with the oldest that pyproject.toml states.
INSTALLED := $(VENV)-$(if $(filter test-oldest,$(MAKECMDGOALS)),oldest,newest)
test-newest test-oldest:
	rm -rf $(INSTALLED) build
	$(PYTHON) -m venv $(INSTALLED)
	$(INSTALLED)/bin/python -m pip install --quiet --disable-pip-version-check \
	  $(if $(filter test-oldest,$@),-c constraints-oldest.txt) . pytest pytest-xdist typing_extensions
	$(INSTALLED)/bin/push-recovery evaluate --suite quick --policies two-stage --out runs/$@
	$(INSTALLED)/bin/python -m pytest -n 2 tests/controllers tests/envs

lint: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

# rows of quick-1 and hard and the numbers of reproduce against another commit's, bit for bit
REF ?= HEAD
same: $(VENV)/run.stamp
	$(BIN)/python benchmarks/same_rows.py $(REF)

# the documentation as a site, in build/docs; any warning and any broken link is an error
docs: $(VENV)/run.stamp
	$(PIP) -e '.[docs]'
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs
	@echo "site: build/docs/index.html"

# the README's table on `hard` again; rows that are in runs/ already are kept
tables: $(VENV)/run.stamp
	$(BIN)/python benchmarks/tables.py

# variants and shipped policies on the leaderboard of the documentation; rows that are in runs/ already are kept
leaderboard: $(VENV)/run.stamp
	$(BIN)/python benchmarks/leaderboard.py

# small faults one by one: do the tests notice? It takes hours; a run that is ended goes on where it was
mutants: $(VENV)/dev.stamp
	$(BIN)/python benchmarks/mutants.py

format: $(VENV)/dev.stamp
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:
	rm -rf $(VENV) $(VENV)-newest $(VENV)-oldest build runs *.egg-info
