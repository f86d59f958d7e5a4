"""What all tests share."""

import torch

# The tests' tensors are small: threads would wait for each other more than they work.
torch.set_num_threads(1)
