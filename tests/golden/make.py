"""Write down what the shipped weights predict; run after new weights are shipped, never to silence a failing test.

.venv/bin/python tests/golden/make.py
"""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from scenes import workshop

from pushgraph import BeliefHistory, load
from pushgraph.network.belief_network import BELIEFS
from pushgraph.physics import MODELS

if __name__ == "__main__":
    tracks = {model: load(model).predict(workshop()) for model in MODELS}
    final = {model: track.poses[-1].round(6).tolist() for model, track in tracks.items()}
    Path(__file__).with_name("predictions.json").write_text(json.dumps(final, indent=1))
    spread = load().predict(workshop(), spread=True).spread.take(-1)
    stated = {name: values.round(6).tolist() for name, values in spread._asdict().items()}
    Path(__file__).with_name("spreads.json").write_text(json.dumps(stated, indent=1))
    believed = {
        model: BeliefHistory.watch(workshop(), tracks["contact"], model).probabilities[-1].round(5).tolist()
        for model in BELIEFS
    }
    Path(__file__).with_name("beliefs.json").write_text(json.dumps(believed, indent=1))
