"""Live views of frames, contacts and grip: a page in the browser, and Foxglove."""
