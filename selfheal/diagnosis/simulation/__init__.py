"""Simulation: batches of rollouts of model variants, and their scores."""
