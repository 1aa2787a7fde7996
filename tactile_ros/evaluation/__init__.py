"""Evaluation of recordings: bags and files in, replay, errors against truth, a report out."""
