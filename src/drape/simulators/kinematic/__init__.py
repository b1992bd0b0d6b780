"""Kinematic prior: cloth goes with its body and hardly stretches."""
