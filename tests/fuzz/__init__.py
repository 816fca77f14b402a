"""Runs that break things on purpose, from a fixed seed: mutated files, kills, pairs at once."""
