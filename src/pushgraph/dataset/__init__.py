"""Datasets: generate them in parallel, store them, sample training windows from them."""
