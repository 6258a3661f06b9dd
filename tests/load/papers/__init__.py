"""What papers.py measures: one module for each paper."""
