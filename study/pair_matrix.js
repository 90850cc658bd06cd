// Enlarges a panel and shows the figures of the bin that is pointed at. Without it everything is still
// there but enlarging: bins have their <title>. %WORDS% are replaced by sizes of a panel.
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
