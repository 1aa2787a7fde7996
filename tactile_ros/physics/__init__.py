"""What the world does: fields of magnets. Functions of arrays alone."""
