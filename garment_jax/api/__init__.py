"""What `import garment_jax as gj` offers, and what the command line calls: from files to files or arrays."""
