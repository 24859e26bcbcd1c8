"""The paper's study from end to end, and its page: the order is in `study`, the page in `page`."""
