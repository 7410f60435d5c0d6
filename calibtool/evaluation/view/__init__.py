"""Views of the arm with nominal and actual targets: an HTML page, or live with viser."""
