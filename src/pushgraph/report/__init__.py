"""The report: every experiment run or reused, and written down as one page."""
