# make demo and make test do all set-up on a fresh machine with Python 3.11 or newer.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

CACHE := $(or $(PUSHGRAPH_CACHE),$(or $(XDG_CACHE_HOME),$(HOME)/.cache)/pushgraph)
DATA := $(CACHE)/data
WEIGHTS := src/pushgraph/weights
BASELINES := baselines/src/pushgraph_baselines
PLANAR := --data $(DATA)/planar.h5 --validation $(DATA)/validation.h5 --processes 1
PARTS := --data $(DATA)/parts.h5 --validation $(DATA)/validation.h5 --processes 1
JOINTED := --data $(DATA)/jointed.h5 --validation $(DATA)/jointed-validation.h5 --processes 1
MASSES := --masses $(DATA)/masses.h5 --masses-validation $(DATA)/masses-validation.h5
RUNS := $(CACHE)/runs
PHYSICS := $(BIN)/pushgraph train physics --precision bfloat16
PROPNET := $(PHYSICS) $(PARTS) --model propnet --frames 10 --batch 16 --hidden 256 --propagation-steps 5
BELIEF := $(BIN)/pushgraph train belief

.PHONY: demo test test-all lint install schema weights weights-contact weights-propnet weights-image weights-belief weights-paper-recipe weights-spread weights-lever-up data docs results clean

install: $(VENV)/.tests

# What the demo needs: neither Ray nor pytest.
$(VENV)/.demo: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "pushgraph needs Python 3.11 or newer; set PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[sim,viewer]'
	@touch $@

$(VENV)/.tests: $(VENV)/.demo baselines/pyproject.toml
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable baselines --editable '.[dev]'
	@touch $@

demo: $(VENV)/.demo
	$(BIN)/pushgraph demo --out demo

test: install lint
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile --no-loadscope-reorder

# What `make test` leaves out as slow, too.
test-all: install lint
	$(BIN)/python -m pytest -m "" --numprocesses 2 --dist loadfile --no-loadscope-reorder

# The documentation as a site, in site/.
docs: install
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build

# docs/results.md: the report's Markdown of the shipped weights, and its figures.
results: install
	$(BIN)/pushgraph report --out $(CACHE)/report
	for figure in $(CACHE)/report/*/*.png; do \
	  suite=$$(basename $$(dirname $$figure)); grep -q "($$suite/$$(basename $$figure))" $(CACHE)/report/report.md || continue; \
	  cp $$figure docs/images/results-$$suite-$$(basename $$figure); done
	sed -e '/^## Replays/,$$d' -e 's#](\([a-z-]*\)/\([a-z_]*\.png\))#](images/results-\1-\2)#' $(CACHE)/report/report.md > docs/results.md

lint: install
	$(BIN)/ruff check .
	$(BIN)/mypy

schema: install
	$(BIN)/python -c 'import json; from pushgraph import Scene; print(json.dumps(Scene.model_json_schema(), indent=2))' \
	  > docs/scene.schema.json
	$(BIN)/python -c 'import json; from pushgraph import LeverScene as S; print(json.dumps(S.model_json_schema(), indent=2))' \
	  > docs/lever-scene.schema.json

# Every shipped checkpoint from nothing; killed, the same command goes on. make -j2 weights trains two side by side.
# Beliefs stand on the physics weights, and spreads on both, so they come after them.
weights: data
	+$(MAKE) weights-contact weights-propnet weights-image weights-lever-up
	+$(MAKE) weights-belief weights-paper-recipe
	+$(MAKE) weights-spread

data: install
	$(BIN)/pushgraph generate planar --objects 9 --count 5888 --seed 0 --out $(DATA)/planar.h5
	$(BIN)/pushgraph generate multiple-parts --objects 9 --count 2400 --seed 0 --out $(DATA)/parts.h5
	$(BIN)/pushgraph generate planar-mixed --objects 12 --count 1600 --seed 0 --out $(DATA)/mixed.h5
	$(BIN)/pushgraph generate multiple-parts --objects 9 --count 200 --seed 900000 --out $(DATA)/validation.h5
	$(BIN)/pushgraph generate jointed --objects 9 --count 7200 --seed 0 --out $(DATA)/jointed.h5
	$(BIN)/pushgraph generate jointed --objects 9 --count 104 --seed 900000 --out $(DATA)/jointed-validation.h5
	$(BIN)/pushgraph generate different-masses-mixed --objects 9 --count 1600 --seed 0 --out $(DATA)/masses.h5
	$(BIN)/pushgraph generate different-masses-mixed --objects 9 --count 64 --seed 900000 \
	  --out $(DATA)/masses-validation.h5
	$(BIN)/pushgraph generate lever-up --drives 125 --seed 0 --out $(DATA)/lever-up.h5
	$(BIN)/pushgraph generate lever-up --drives 64 --seed 900000 --out $(DATA)/lever-up-validation.h5

weights-contact: data
	$(BIN)/pushgraph train physics $(PLANAR) --model contact --samples 300000 --run-folder $(RUNS)/contact --out $(WEIGHTS)/contact.safetensors

# From nothing exact velocities spoil it; once it has learnt what pushes, they help.
weights-propnet: data
	$(PROPNET) --samples 1300000 --learning-rate 1e-3 --run-folder $(RUNS)/propnet-1 --out $(CACHE)/propnet-1.safetensors
	$(PROPNET) --samples 350000 --learning-rate 5e-4 --velocity-noise 0.03 --least-gain 0 --seed 1 \
	  --start-from $(CACHE)/propnet-1.safetensors --run-folder $(RUNS)/propnet --out $(BASELINES)/propnet.safetensors

# The shipped ones had these samples in two stages: docs/experiments.md.
weights-image: data
	$(BIN)/pushgraph train physics $(PARTS) --model image --samples 253000 --frames 8 --batch 32 --learning-rate 1e-3 \
	  --hidden 128 --propagation-steps 3 --run-folder $(RUNS)/image --out $(BASELINES)/image.safetensors

# The shipped one had 2,400 scenes in its first five stages, and in the sixth 2,400 of each of the seeds 0, 1 and 2.
weights-belief: data
	$(BELIEF) $(JOINTED) --frames 100 --samples 1200000 --learning-rate 2e-3 --out $(CACHE)/belief-1.safetensors
	$(BELIEF) $(JOINTED) --frames 100 --samples 1200000 --learning-rate 1.5e-3 --seed 1 \
	  --start-from $(CACHE)/belief-1.safetensors --out $(CACHE)/belief-2.safetensors
	$(BELIEF) $(JOINTED) --frames 100 --samples 2000000 --learning-rate 2e-3 --seed 2 \
	  --start-from $(CACHE)/belief-2.safetensors --out $(CACHE)/belief-3.safetensors
	$(BELIEF) $(JOINTED) --frames 100 --samples 2400000 --learning-rate 1.5e-3 --least-gain 0 --seed 11 \
	  --start-from $(CACHE)/belief-3.safetensors --out $(CACHE)/belief-4.safetensors
	$(BELIEF) $(JOINTED) --frames 100 --samples 1600000 --learning-rate 1.2e-3 --least-gain 0 --seed 13 \
	  --start-from $(CACHE)/belief-4.safetensors --out $(CACHE)/belief-5.safetensors
	$(BELIEF) $(JOINTED) --frames 100 --samples 2800000 --learning-rate 5e-4 --share-of-start 0.5 --seed 16 \
	  --start-from $(CACHE)/belief-5.safetensors --out $(CACHE)/belief-6.safetensors
	$(BELIEF) $(JOINTED) $(MASSES) --keep-joints --batch 16 --samples 1000000 --learning-rate 6e-3 \
	  --start-from $(CACHE)/belief-6.safetensors --out $(CACHE)/belief-7.safetensors
	$(BELIEF) $(JOINTED) $(MASSES) --keep-joints --batch 64 --samples 2400000 --learning-rate 2e-3 --least-gain 0 --seed 42 \
	  --start-from $(CACHE)/belief-7.safetensors --run-folder $(RUNS)/belief --out $(WEIGHTS)/belief.safetensors

weights-paper-recipe: data
	$(BELIEF) $(PARTS) --model paper_recipe --hidden 256 --frames 100 --batch 8 --samples 560000 --learning-rate 2e-3 \
	  --precision bfloat16 --run-folder $(RUNS)/paper_recipe --out $(BASELINES)/paper_recipe.safetensors

weights-spread: data
	$(BIN)/pushgraph train spread --data $(DATA)/mixed.h5 --validation $(DATA)/validation.h5 --processes 1 \
	  --rollouts 19200 --samples 8000000 --run-folder $(RUNS)/spread --out $(WEIGHTS)/spread.safetensors

weights-lever-up: data
	$(BIN)/pushgraph train lever-up --data $(DATA)/lever-up.h5 --validation $(DATA)/lever-up-validation.h5 --processes 1 \
	  --samples 12800 --run-folder $(RUNS)/lever_up --out $(WEIGHTS)/lever_up.safetensors
	$(BIN)/pushgraph train lever-up --model lever_up_propnet --data $(DATA)/lever-up.h5 --processes 1 \
	  --validation $(DATA)/lever-up-validation.h5 --samples 400000 --run-folder $(RUNS)/lever_up_propnet \
	  --out $(BASELINES)/lever_up_propnet.safetensors

clean:
	rm -rf $(VENV) demo
