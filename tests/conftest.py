"""What all tests share."""

import pytest
import torch

# The tests' tensors are small: threads would wait for each other more than they work.
torch.set_num_threads(1)

LONGEST = (
    *("test_training", "test_doc_pages", "test_examples", "test_recording_readers", "test_dataset"),
    *("test_physics", "test_belief"),
)
"""Files that take longest: begun first, so that no process is left alone with one of them in the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest."""
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path.stem, len(order)))
