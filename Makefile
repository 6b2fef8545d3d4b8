# `make build` and `make test` do all set-up themselves, on a bare Debian or Ubuntu box as well.

VENV := .venv/bin
OUT ?= out/first
EPISODES ?= 2
TASK ?= click_bell
LEVELS ?= 0,1,3
PUMA ?= out/puma
CONFIG ?= puma-small
MANY ?= out/puma-many
TASKS ?= click_bell,place_container_plate,beat_block_hammer,shake_bottle,grab_roller,handover_block

# one thread a process: the work is spread over processes
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1
export LP_NUM_THREADS ?= 1

# many short processes start: let them reuse bytecode
unexport PYTHONDONTWRITEBYTECODE

.PHONY: build puma puma-many test slow readme lint docs core setup clean help

build: core  ## set up the core, then make, export and verify the first dataset (OUT, TASKS, EPISODES)
	$(VENV)/domino-data build --embodiment aloha --levels 1,2,3 --tasks $(TASKS) --episodes $(EPISODES) --out $(OUT) || test $$? = 3
	$(VENV)/domino-data export $(OUT) --format lerobot
	$(VENV)/domino-data verify $(OUT)

puma: setup  ## make a dataset of one task, train a small policy on its images, evaluate it in closed loop (TASK, LEVELS, CONFIG, PUMA)
	$(VENV)/domino-data build --manifest manifests/puma-small.yaml --tasks $(TASK) --levels $(LEVELS) --out $(PUMA)/data || test $$? = 3
	$(VENV)/domino-data export $(PUMA)/data --format parquet
	$(VENV)/puma train --config $(CONFIG) --data $(PUMA)/data --out $(PUMA)/run --set data.cache=$(PUMA)/cache
	$(VENV)/puma replay-check $(PUMA)/run
	$(VENV)/puma eval $(PUMA)/run --tasks $(TASK) --embodiment aloha --levels $(LEVELS) --episodes 50 --out $(PUMA)/evaluation

puma-many: setup  ## train one policy for twelve tasks by their sentences, and evaluate it: hours; `puma many --plan` estimates them (MANY)
	$(VENV)/puma many --out $(MANY)

test: setup  ## run the tests
	$(VENV)/pytest

readme: setup  ## run every command of README.md and of the pages that add something, as written (10 minutes)
	$(VENV)/pytest -n 2 -m slow tests/test_docs_followed.py

slow: setup  ## run the tests that take minutes: training by lerobot-train, training in several processes
	# a process that had a Ray of its own joins no cluster: these tests have one for themselves
	$(VENV)/pytest -n 0 -m slow tests/run/test_cluster.py
	$(VENV)/pytest -n 2 -m slow --ignore=tests/test_docs_followed.py --ignore=tests/run/test_cluster.py

lint: setup  ## check style, types, words, and which room imports which
	$(VENV)/ruff check
	$(VENV)/ruff format --check
	$(VENV)/pyright
	$(VENV)/lint-imports --no-logo
	$(VENV)/python scripts/check_words.py

docs: setup  ## make the pages of docs/ a site in out/site; a broken link ends it
	$(or $(wildcard .tools/bin/uvx),uvx) --with mkdocs-material==9.7.* --from mkdocs==1.6.1 mkdocs build --quiet --strict

core:  ## make .venv from the lock: uv, Python 3.12, what builds and exports datasets
	@scripts/setup.sh core

setup:  ## the same with every extra and what the tests need
	@scripts/setup.sh all

clean:  ## remove the environment and caches
	rm -rf .venv .tools dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache

help:  ## list the targets
	@sed -nE 's/^([a-z-]+):[^#]*## (.*)/  make \1	\2/p' $(MAKEFILE_LIST) | expand -t 16
