# `make build` and `make test` do all set-up themselves, on a bare Debian or Ubuntu box as well.

VENV := .venv/bin
OUT ?= out/first
EPISODES ?= 2
TASKS ?= click_bell,place_container_plate,beat_block_hammer,shake_bottle,grab_roller,handover_block

# one thread a process: the work is spread over processes
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MKL_NUM_THREADS ?= 1
export LP_NUM_THREADS ?= 1

# many short processes start: let them reuse bytecode
unexport PYTHONDONTWRITEBYTECODE

.PHONY: build test lint bench setup clean

build: setup
	$(VENV)/domino-data build --embodiment aloha --levels 1,2,3 --tasks $(TASKS) --episodes $(EPISODES) --out $(OUT)
	$(VENV)/domino-data export $(OUT) --format lerobot
	$(VENV)/domino-data verify $(OUT)

test: setup
	$(VENV)/pytest

lint: setup
	$(VENV)/ruff check
	$(VENV)/ruff format --check
	$(VENV)/pyright

bench: setup
	@for file in benchmarks/[a-z]*.py; do \
		echo "== $$file"; $(VENV)/python -m "benchmarks.$$(basename $$file .py)" || exit 1; \
	done

setup:
	@scripts/setup.sh

clean:
	rm -rf .venv .tools dist .pytest_cache .ruff_cache .hypothesis
