"""Drawing, formatted tables and HTML pages. Knows nothing of ships.

- `drawing`: style, colours, and figures as SVG or PNG.
- `tables`: numbers formatted into the cells of a table.
- `page`: a page written from its template, with figures and tables beside it.
"""
