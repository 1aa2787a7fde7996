"""Benches: figures beside those of the papers, of peers, of bounds and aims."""
