#!/usr/bin/env bash
# Whether anything on a report's page must be scrolled sideways: in headless Chromium, per page and
# width, the page itself and each table. Exit 1 where something is, 77 without Chromium.
#
#     tests/evidence/pages.sh report.html...
set -euo pipefail
chromium=$(command -v chromium || command -v google-chrome) || { echo "no Chromium: skipped"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
status=0
for page in "$@"; do
    cat >"$work/frame.html" <<HTML
<!DOCTYPE html><iframe id="page" src="file://$(realpath "$page")" style="height:900px"></iframe>
<pre id="found"></pre>
<script>
addEventListener('load', () => {
  const frame = document.getElementById('page'), scrolls = e => e.scrollWidth > e.clientWidth;
  for (const width of [1600, 1200, 800, 400]) {
    frame.style.width = width + 'px';
    const page = frame.contentDocument, found = [];
    if (scrolls(page.documentElement)) found.push('PAGE');
    for (const details of page.querySelectorAll('details')) details.open = true;
    for (const table of page.querySelectorAll('.table'))
      if (scrolls(table)) found.push('TABLE ' + table.querySelector('th').textContent);
    document.getElementById('found').textContent +=
      'width ' + width + ': ' + (found.length ? found.join(', ') + ' scrolls' : 'nothing scrolls') + '\n';
  }
});
</script>
HTML
    echo "$page"
    "$chromium" --headless --no-sandbox --disable-gpu --allow-file-access-from-files \
        --user-data-dir="$work/profile" --virtual-time-budget=10000 --window-size=1700,1000 \
        --dump-dom "file://$work/frame.html" 2>/dev/null |
        sed -n 's/^.*\(width [0-9]*: .*\)$/    \1/p' | grep -v '+ width' | tee "$work/found"
    [ "$(grep -c 'nothing scrolls' "$work/found")" -eq 4 ] || status=1
done
exit $status
