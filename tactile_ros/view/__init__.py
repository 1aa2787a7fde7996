"""What a viewer is shown of frames, contacts and grip: drawn by Foxglove, not by this package."""
