"""The paper's study from end to end, and its page."""
