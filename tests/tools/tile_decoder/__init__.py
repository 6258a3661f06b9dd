"""A second decoder of tiles. It shares no code with the one in `protocol/`, but follows the same models and predictions."""
