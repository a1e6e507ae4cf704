"""What a report's page says: its tables as lists of rows, its text, and whatever points outside."""

import json
from html.parser import HTMLParser

from vibrident.show import report


class Reader(HTMLParser):
    """Tables as lists of rows of cells, text, and whatever points outside."""

    def __init__(self, page: str):
        super().__init__()
        self.tables, self.outside, self.words, self.open, self.figures = [], [], [], [], {}
        start, end = page.index("<script>"), page.rindex("</script>", 0, page.rindex("<script>"))
        self.feed(page[:start] + page[end + len("</script>") :])  # plotly's own script is long and of no interest

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "link", "br"):
            self.open.append(tag)
        named = dict(attrs)
        self.outside += [
            value for key, value in attrs if key in ("src", "href", "action", "srcset") and value[0] != "#"
        ]
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")
        self.data_id = named.get("id") if tag == "script" else None

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "script" in self.open:
            if self.data_id == "figures":
                self.figures = json.loads(data)
        elif "style" not in self.open:
            self.words.append(data)
            if (self.open and "td" in self.open) or "th" in self.open:
                self.tables[-1][-1][-1] += data

    def table(self, *header: str):
        return next(t[1:] for t in self.tables if t and t[0][: len(header)] == list(header))


def read(result) -> Reader:
    return Reader(report.content(result, "html").decode())
