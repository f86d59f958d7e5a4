"""Write down what the shipped weights predict; run after new weights are shipped, never to silence a failing test.

.venv/bin/python tests/golden/make.py
"""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from scenes import workshop

from pushgraph import load
from pushgraph.physics import MODELS

if __name__ == "__main__":
    final = {model: load(model).predict(workshop()).poses[-1].round(6).tolist() for model in MODELS}
    Path(__file__).with_name("predictions.json").write_text(json.dumps(final, indent=1))
