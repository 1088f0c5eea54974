"""Photons followed one by one: a Monte Carlo that shares nothing with the solver but the scene."""
