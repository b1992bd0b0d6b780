"""Benchmarks of cost and accuracy: each member measures one thing, in one run on one machine."""
