"""Every link of the site to a heading leads to one; doxygen's own pages in cpp/ are left out.
    check_anchors.py SITE_FOLDER"""
import html.parser
import pathlib
import sys
import urllib.parse


class Page(html.parser.HTMLParser):
    def __init__(self, path):
        super().__init__()
        self.ids, self.links = set(), []
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        named = dict(attributes)
        self.ids.add(named.get("id"))
        if tag == "a" and "href" in named:
            self.links.append(named["href"])


site = pathlib.Path(sys.argv[1]).resolve()
pages = {path: Page(path) for path in site.rglob("*.html")
         if path.name != "404.html" and path.parent != site / "cpp"}
broken = 0
for path, page in pages.items():
    for link in page.links:
        url = urllib.parse.urlparse(link)
        if url.scheme or not url.fragment:
            continue
        target = (path.parent / url.path).resolve() if url.path else path
        if target in pages and urllib.parse.unquote(url.fragment) not in pages[target].ids:
            print(f"{path.relative_to(site)}: no heading for {link}", file=sys.stderr)
            broken += 1
sys.exit(1 if broken else 0)
