# Each target sets up all it needs from a bare machine with Python 3.11 to 3.14: `make demo`, `make test`.

# The first of these that is installed; constraints.txt was made with 3.11.
PYTHON ?= $(firstword $(foreach each,python3.11 python3.12 python3.13 python3.14,$(shell command -v $(each))) python3)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
APP_STAMP := $(VENV)/.app-installed
# Two threads are plenty for images of 96 x 72, and BLAS threads only get in each other's way.
export OMP_NUM_THREADS ?= 2
export OPENBLAS_NUM_THREADS ?= 1
# The tests start hundreds of processes, and each would compile the whole program anew.
unexport PYTHONDONTWRITEBYTECODE

# So many test processes of one thread each. What stays together, and what comes first, is said in tests/longest_first.py.
PROCESSES ?= 2
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n $(PROCESSES) --dist loadscope --no-loadscope-reorder

.PHONY: help demo robot-demo test test-times test-fast campaign coverage format lint type check bench docs pictures clean

help:  ## List the targets.
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

demo: $(APP_STAMP)  ## Open the page on the demo apartment and its ready-made map.
	$(BIN)/ltvn app

robot-demo: $(APP_STAMP)  ## Open the page on a robot of ROS 2: the simulated one, with router and guard.
	$(BIN)/ltvn demo --robot

test: $(STAMP) chromium  ## Run every test, the browser's among them.
	$(PYTEST)

test-times: $(STAMP) chromium  ## Run every test, and keep what each module took: the order of the next runs.
	$(PYTEST) --keep-times

test-fast: $(STAMP)  ## Run the tests that need no browser and little time.
	$(PYTEST) -m 'not browser and not slow'

# Each campaign stops when its share of the time is over, and says how many attempts it made.
export LTVN_CAMPAIGN_MINUTES ?= 15
campaign: $(STAMP) chromium  ## Kill, damage, flood and soak for 15 minutes, and print what came of it.
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest tests/campaigns -m campaign

coverage: $(STAMP) chromium  ## Run every test and print what share of the lines they run; takes longer.
	$(PYTEST) --cov ltvn_core --cov ltvn_viz --cov-report term:skip-covered

format: $(STAMP)  ## Format the code.
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lint: $(STAMP)  ## Check style.
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-cache --no-logo

type: $(STAMP)  ## Check types.
	$(BIN)/pyright

check: lint type test  ## Everything that must be clean before a commit.

bench: $(STAMP)  ## Measure the budgets of docs/performance.md; prints JSON.
	$(BIN)/python -m benchmarks --json -

docs: $(STAMP)  ## Build the documentation site into site/; it fetches nothing.
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

pictures: $(STAMP) chromium  ## Take all pictures of the page for the documentation anew; long without a graphics card.
	$(BIN)/python -m tests.browser.tab_screenshots
	$(BIN)/python -m tests.browser.debugger_screenshots
	$(BIN)/python -m tests.browser.story_film
	story=$$(mktemp -d) && $(BIN)/ltvn demo --headless --story --recording $$story/story.rrd && \
	$(BIN)/python -m figures.story_strip $$story/story.rrd && rm -r $$story

clean:  ## Remove the environment.
	rm -rf $(VENV)

.PHONY: python chromium
python:
	@command -v $(PYTHON) >/dev/null 2>&1 || { \
	  echo "make: $(PYTHON) was not found. Install Python 3.11 to 3.14,"; \
	  echo "make: or name an interpreter: make $(MAKECMDGOALS) PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' || { \
	  echo "make: $(PYTHON) is not Python 3.11 to 3.14. Name another: make $(MAKECMDGOALS) PYTHON=python3.11"; exit 1; }

chromium: $(STAMP)
	@$(BIN)/python -m tests.browser.chromium

# The demo needs a third of what tests and documentation need, and somebody waits for it.
# PyTorch first: on Linux pip would else choose a build with 2.7 GB of CUDA libraries.
$(APP_STAMP): pyproject.toml constraints.txt | python
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python tools/install_torch.py
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[all]'
	touch $(APP_STAMP)

$(STAMP): $(APP_STAMP)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $(STAMP)
