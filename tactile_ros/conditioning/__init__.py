"""Stream steps: what happens to a frame before it is estimated from."""
