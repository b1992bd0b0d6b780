"""Implicit Euler steps: minimisation of an incremental potential."""
