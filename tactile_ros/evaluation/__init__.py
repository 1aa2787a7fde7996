"""What a recording is worth: bags and files in, replay, errors against truth, a report out."""
