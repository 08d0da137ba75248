# Shepherd, from a fresh clone. `make help` lists the commands.
#
# PORT           where to serve (8000)            HOST  on which address (127.0.0.1)
# SHEPHERD_DATA  database, saves, logs, secrets (var/)
# PYTHON         the interpreter of a new .venv   ARGS  further arguments of pytest, benchmarks, experiments

VENV := .venv
BIN := $(VENV)/bin
MODERN := import sys; sys.exit(sys.version_info < (3, 11))
PYTHON ?= $(shell for python in python3 python3.13 python3.12 python3.11; do \
	$$python -c '$(MODERN)' 2>/dev/null && echo $$python && break; done)
CLIENTS := -e clients/python -e clients/environments
NODE_FOLDERS := clients/javascript frontend/bored
NPM_INSTALL := npm install --silent --no-audit --no-fund --no-package-lock
WORKERS ?= $(shell echo $$(( $$(nproc) + 1 )))# one more than cores: tests that kill and restart mostly wait
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help setup run scaled demo test faults bench experiments screenshots lint audit format clean

help:  ## List the commands
	@grep -E '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /make \1\t/' | expand -t 20

setup: $(VENV)/.dev  ## Make .venv with everything that tests and lint need

run: $(VENV)/.runtime  ## Serve on this machine until Ctrl-C; the first time with something to look at
	@$(BIN)/python manage.py serve --demo-data

scaled: export DATABASE_URL ?= postgres://postgres@127.0.0.1:5432/shepherd
scaled: export REDIS_URL ?= redis://127.0.0.1:6379/0
scaled: $(VENV)/.runtime  ## Serve with two web processes, two Celery workers and beat, on PostgreSQL and Redis
	@$(BIN)/python manage.py scaled

demo: $(VENV)/.runtime  ## Serve, train an agent on Cart Pole with a real client, and go on serving
	@$(BIN)/python manage.py demo

test: $(VENV)/.dev  ## Run all tests but those of make faults
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder $(ARGS)

faults: $(VENV)/.dev  ## Break every part of the scaled-out set-up under load (minutes)
	$(BIN)/python -m pytest -m long $(ARGS)

bench: $(VENV)/.dev  ## Measure speed and memory, and show them beside their bars; SCALED=1: of the scaled-out set-up
	$(BIN)/python -m benchmarks $(if $(SCALED),--scaled) $(ARGS)

experiments: $(VENV)/.dev  ## Play the figures of the thesis that are missing (hours), and show them
	$(BIN)/python -m experiments $(ARGS)

screenshots: $(VENV)/.dev  ## Take the pictures of docs/screenshots anew (needs Chromium)
	$(BIN)/python -m tests.browser.screenshots

lint: $(VENV)/.dev  ## Check style, types, migrations and settings
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy .
	$(BIN)/python manage.py makemigrations --check --dry-run
	$(BIN)/python manage.py check

audit: $(VENV)/.dev  ## Look for dangerous code, settings and dependencies (the last needs the network)
	$(BIN)/bandit --quiet --configfile pyproject.toml --recursive agents_app envs_app shepherd frontend clients manage.py
	SHEPHERD_TLS=1 SHEPHERD_ALLOWED_HOSTS=shepherd.example $(BIN)/python manage.py check --deploy --fail-level WARNING
	@$(BIN)/pip freeze --exclude-editable | $(BIN)/pip-audit --strict --no-deps --disable-pip --requirement /dev/stdin || { \
		echo "pip-audit says above what it found, or what it could not look up; what was not looked up is not known to be safe."; exit 1; }

format: $(VENV)/.dev  ## Format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:  ## Delete .venv and caches, not the data
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "Shepherd needs Python 3.11 or newer, and none was found: install it, or say make PYTHON=/path/to/python."; exit 1; }
	@command -v "$(PYTHON)" >/dev/null || { echo "There is no $(PYTHON): say make PYTHON=/path/to/python, 3.11 or newer."; exit 1; }
	@$(PYTHON) -c '$(MODERN)' || { echo "Shepherd needs Python 3.11 or newer; $(PYTHON) is $$($(PYTHON) -V 2>&1): say make PYTHON=/path/to/python."; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "The virtual environment could not be made. On Debian and Ubuntu: apt install python3-venv."; exit 1; }

# The stamps make a second call quick: pip runs again only when the requirements have changed.
$(VENV)/.runtime: requirements.txt clients/python/pyproject.toml clients/environments/pyproject.toml | $(BIN)/python
	@echo "Installing what Shepherd runs on into $(VENV) ..."
	@$(BIN)/pip install --quiet -r requirements.txt $(CLIENTS) || { echo "The installation failed: see pip's message above."; exit 1; }
	@touch $@

$(VENV)/.dev: requirements-dev.txt $(VENV)/.runtime
	@echo "Installing what tests and lint need into $(VENV) ..."
	@$(BIN)/pip install --quiet -r requirements-dev.txt || { echo "The installation failed: see pip's message above."; exit 1; }
	@for folder in $(NODE_FOLDERS); do $(NPM_INSTALL) --prefix $$folder || echo "No npm in $$folder: its types, and axe-core's findings, are not tested."; done
	@touch $@
