#include <fmt/format.h>

#include "core/file/text.h"
#include "study/pair_matrix.h"
#include "study/pair_matrix_svg.h"

namespace etalon {
namespace {

// Densities are drawn for light paper; on dark paper lightness is turned around and hues are kept.
constexpr const char* page_style = R"css(
:root{--mean:#d1131f}
@media(prefers-color-scheme:dark){:root{--mean:#ffd54a}@media screen{.pairs .density,.pair-large .density{filter:invert(1) hue-rotate(180deg) brightness(1.25)}}}
.pair-tabs>input{position:absolute;opacity:0;pointer-events:none}
.pair-tabs>label{display:inline-block;padding:6px 14px;margin:0 4px 10px 0;border:1px solid var(--line);
border-radius:6px;cursor:pointer;background:var(--card);color:var(--soft)}
.pair-tabs>input:checked+label{color:var(--text);border-color:var(--text);font-weight:600}
.pair-tabs>input:focus-visible+label{outline:2px solid var(--text);outline-offset:2px}
.pair-page{display:none;overflow-x:auto;background:var(--card);border:1px solid var(--line);border-radius:6px;padding:8px}
.pair-page svg{min-width:900px}
.panel{cursor:zoom-in}.panel:focus-visible{outline:2px solid var(--text)}
.panel .bin{fill:var(--text);fill-opacity:0}.panel .bin:hover{fill-opacity:.12}
.pair-says{position:fixed;z-index:9;pointer-events:none;white-space:pre-line;background:var(--paper);color:var(--text);
border:1px solid var(--soft);border-radius:6px;padding:5px 9px;font-size:.8rem;line-height:1.35;
font-variant-numeric:tabular-nums;box-shadow:0 2px 8px #0004;max-width:260px}
.pair-large{border:1px solid var(--line);border-radius:8px;background:var(--card);color:var(--text);padding:12px;max-width:96vw;overflow:hidden}
.pair-large::backdrop{background:#0009}.pair-large .panel{cursor:zoom-out}.pair-large .panel>.grid,.pair-large .panel>.axis{display:none}
.pair-large path{vector-effect:non-scaling-stroke}.pair-large .mean{stroke-width:3}.pair-large .spread{stroke-width:2}.pair-large .halo{stroke-width:6}
.pair-large .title{font-size:14px;font-weight:600}
@media print{.pair-tabs>label{display:none}.pair-page{display:block;break-inside:avoid;margin-bottom:1em}.pair-page svg{min-width:0}}
)css";

// Without it everything is still there but enlarging: bins have their <title>.
constexpr const char* script = R"js(
<script>
(() => {
  const says = document.createElement('div'), large = document.createElement('dialog');
  says.className = 'pair-says'; says.hidden = true; large.className = 'pair-large';
  document.body.append(says, large);
  document.querySelectorAll('.bin').forEach(bin => {
    bin.setAttribute('aria-label', bin.textContent); bin.replaceChildren();
  });
  const show = event => {
    const bin = event.target.closest && event.target.closest('.bin');
    says.hidden = !bin;
    if (!bin) return;
    (large.open ? large : document.body).append(says);
    says.textContent = bin.getAttribute('aria-label');
    const box = says.getBoundingClientRect();
    says.style.left = Math.max(4, Math.min(event.clientX + 14, innerWidth - box.width - 6)) + 'px';
    says.style.top = (event.clientY + 18 + box.height < innerHeight ? event.clientY + 18
                                                                    : event.clientY - box.height - 10) + 'px';
  };
  document.addEventListener('pointermove', show);
  document.addEventListener('scroll', () => { says.hidden = true; }, true);

  const ticks = (low, high, most, angle) => {
    const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
    const steps = angle && high - low >= 60 ? [15, 30, 45, 90] : [1, 2, 5, 10].map(f => f * power);
    const step = steps.find(s => s >= raw * 0.999) || steps[3], all = [], end = 0.01 * (high - low);
    for (let i = Math.ceil((low - end) / step); i * step <= high + end; ++i) all.push(+(i * step).toPrecision(6));
    return all;
  };
  const enlarge = panel => {
    const [xName, x0, x1] = panel.dataset.x.split('|'), [yName, y0, y1] = panel.dataset.y.split('|');
    const W = Math.min(940, innerWidth - 60), H = Math.max(260, Math.min(0.68 * W, innerHeight - 90));
    const l = 66, t = 30, w = W - l - 22, h = H - t - 46, rim = h * %RIM%;
    const X = v => l + w * (v - x0) / (x1 - x0), Y = v => t + rim + (h - 2 * rim) * (y1 - v) / (y1 - y0);
    let axes = `<text class='title' x='${l}' y='17'></text>`;
    for (const v of ticks(+x0, +x1, Math.max(4, W / 90), xName.endsWith('deg')))
      axes += `<line class='grid' x1='${X(v)}' x2='${X(v)}' y1='${t}' y2='${t + h}'/><text x='${X(v)}' y='${t + h + 16}' text-anchor='middle'>${v}</text>`;
    for (const v of ticks(+y0, +y1, H / 50, yName.endsWith('deg')))
      axes += `<line class='grid' x1='${l}' x2='${l + w}' y1='${Y(v)}' y2='${Y(v)}'/><text x='${l - 6}' y='${Y(v) + 4}' text-anchor='end'>${v}</text>`;
    axes += `<text x='${l + w / 2}' y='${H - 8}' text-anchor='middle'>${xName}</text>` +
      `<text transform='translate(14 ${t + h / 2}) rotate(-90)' text-anchor='middle'>${yName}</text>`;
    large.innerHTML = `<svg class='plot' style='width:${W}px' viewBox='0 0 ${W} ${H}'>` +
      `<rect width='${W}' height='${H}' fill='var(--card)'/>${axes}<rect class='axis' x='${l}' y='${t}' width='${w}' height='${h}'/></svg>`;
    large.querySelector('.title').textContent = panel.dataset.name;
    const copy = panel.cloneNode(true);
    copy.setAttribute('transform', `translate(${l} ${t}) scale(${w / %WIDTH%} ${h / %HEIGHT%})`);
    copy.removeAttribute('tabindex');
    copy.querySelector('.paper').remove();
    large.firstChild.append(copy);
    large.showModal();
  };
  document.querySelectorAll('.pair-page .panel').forEach(panel => {
    panel.addEventListener('click', () => enlarge(panel));
    panel.addEventListener('keydown', event => {
      if (event.key === 'Enter' || event.key === ' ') { event.preventDefault(); enlarge(panel); }
    });
  });
  large.addEventListener('click', () => { document.body.append(says); says.hidden = true; large.close(); });
})();
</script>
)js";

std::string with(std::string text, const std::string& word, double value) {
    return text.replace(text.find(word), word.size(), fmt::format("{:.6g}", value));
}

std::string sized_script() {
    std::string text = with(script, "%RIM%", panel_rim / panel_height);
    text = with(std::move(text), "%WIDTH%", panel_width);
    return with(std::move(text), "%HEIGHT%", panel_height);
}

}  // namespace

void add_pair_matrices(HtmlPage& page, std::span<const PairMatrix> matrices) {
    if (matrices.empty())
        return;
    page.add_style(pair_matrix_style(PairPicture::in_page) + page_style);
    std::string tabs, pages, rules;
    for (std::size_t i = 0; i < matrices.size(); ++i) {
        tabs += fmt::format(
            "<input type=\"radio\" name=\"pairs\" id=\"pairs{0}\"{1}><label for=\"pairs{0}\">{2}"
            "</label>",
            i, i == 0 ? " checked" : "", escape_html(matrices[i].detector));
        pages += fmt::format("<div class=\"pair-page pairs{}\">{}</div>", i,
                             pair_matrix_picture(matrices[i], PairPicture::in_page));
        rules += fmt::format("#pairs{0}:checked~.pairs{0}{{display:block}}", i);
    }
    page.add_style(rules);
    page.add_html("<div class=\"pair-tabs\">" + tabs + pages + "</div>" + sized_script());
}

}  // namespace etalon
