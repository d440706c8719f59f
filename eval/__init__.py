"""The referee: runs trackers on sequences and scores what they answer. Run it as ``python -m eval``."""
