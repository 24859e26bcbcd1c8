"""Drawing, formatted tables and HTML pages, independent of ships.

- `drawing`: style, colours, and figures as SVG or PNG.
- `tables`: numbers formatted into the cells of a table.
- `page`: a page written from its template, with its figures and tables.
"""
