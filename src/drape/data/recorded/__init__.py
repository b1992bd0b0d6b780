"""Cloth that somebody has recorded or simulated, from files of any kind to a data set that a law is learned from."""
