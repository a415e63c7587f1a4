"""How do results look? Pictures, tables and reports of named data.

In: arrays with their names and units, sentences, tables. Out: matplotlib figures, an HTML page with its pictures beside it.
No result knows how it is drawn, and nothing here knows a result: each wing hands over what it has from its own ``plots``
and ``report``. Matplotlib and jinja2 load when the first picture or page is made.

Rooms: `plots` (what all figures share), `report` (sections, tables, pictures, the page).
"""
