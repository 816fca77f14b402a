"""Runs that break things on purpose, from a fixed seed: mutated files, kills at file operations, pairs at once."""
