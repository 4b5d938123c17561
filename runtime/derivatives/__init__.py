"""Derivatives of steps and runs: tangents, adjoints, gradients."""
