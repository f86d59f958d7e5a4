# make demo and make test do all set-up on a fresh machine with Python 3.11 or newer.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test lint install schema clean

install: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "pushgraph needs Python 3.11 or newer; set PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev,cluster]'
	@touch $@

demo: install
	$(BIN)/pushgraph demo --out demo

test: install lint
	$(BIN)/python -m pytest

lint: install
	$(BIN)/ruff check .

schema: install
	$(BIN)/python -c 'import json; from pushgraph import Scene; print(json.dumps(Scene.model_json_schema(), indent=2))' \
	  > docs/scene.schema.json

clean:
	rm -rf $(VENV) demo
