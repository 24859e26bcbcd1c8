"""Drawing, formatted tables and the writer of pages."""
