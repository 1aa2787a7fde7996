"""Worlds in which sensors grip, press and slide, written apart from what estimates."""
