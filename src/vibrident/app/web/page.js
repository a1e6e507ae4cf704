// What the browser does by itself: remembers that there are data, follows the steps, fits charts to their place.
window.vibrident = {
  hold(now) {
    if (now) sessionStorage.vibridentHeld = 'yes'; else sessionStorage.removeItem('vibridentHeld');
  },
  go(name) {
    const calm = matchMedia('(prefers-reduced-motion: reduce)').matches;
    document.getElementById(name)?.scrollIntoView({ behavior: calm ? 'auto' : 'smooth', block: 'start' });
    document.getElementById(name + '-title')?.focus({ preventScroll: true });
  },
  see(name) {
    document.getElementById(name)?.scrollIntoView({ block: 'nearest' });
  },
  async draw(id, text) {
    const place = document.getElementById(id), { data, layout } = JSON.parse(text);
    const { Plotly } = await import('nicegui-plotly');
    // One after another: plotly stumbles over a second drawing of a chart before the first is done.
    this.drawing = (this.drawing ?? Promise.resolve()).then(
      () => place?.isConnected && Plotly.react(place, data, this.room(place, data, layout), this.tools(place)),
    ).catch(error => place?.isConnected && console.warn(error));
  },
  tools(place) {  // a narrow chart has no toolbar: it would lie on the legend
    return { responsive: false, displaylogo: false, displayModeBar: place.clientWidth < 520 ? false : 'hover' };
  },
  room(place, data, layout) {  // of a narrow chart the choice of the axis stands above the key, not on it
    const menu = layout.updatemenus?.[0];
    if (!menu) return layout;
    const lines = place.clientWidth < 520 ? data.filter(trace => trace.showlegend).length : 0;
    const more = 20 * lines, change = more - (layout.meta ?? 0);
    return { ...layout, meta: more, height: layout.height + change,
      margin: { ...layout.margin, t: layout.margin.t + change },
      updatemenus: [{ ...menu, pad: { ...menu.pad, b: 4 + more } }] };
  },
  async fit() {
    const { Plotly } = await import('nicegui-plotly');
    for (const plot of document.querySelectorAll('.chart.js-plotly-plot')) {
      if (!plot._fullLayout || !plot.offsetParent || plot.clientWidth === plot._fullLayout.width) continue;
      const fitted = this.tools(plot).displayModeBar === plot._context.displayModeBar
        ? Plotly.Plots.resize(plot)
        : Plotly.newPlot(plot, plot.data, { ...this.room(plot, plot.data, plot.layout), width: plot.clientWidth },
          this.tools(plot));
      await fitted.catch(() => {});  // one that was taken away meanwhile
    }
  },
  sent(id) {  // the uploader is emptied once the answer is here: to do it earlier would break the upload off
    setTimeout(() => getElement(id)?.$refs.qRef.removeUploadedFiles());
  },
  name(id, button, input) {  // the parts of an uploader, for a screen reader
    const root = getHtmlElement(id), name = () => {
      root.querySelector('.q-uploader__header a.q-btn')?.setAttribute('aria-label', button);
      root.querySelector('input[type=file]')?.setAttribute('aria-label', input);
    };
    new MutationObserver(name).observe(root, { childList: true, subtree: true });
    name();
  },
  folders(id, choose, files, folder) {
    const box = getElement(id), root = getHtmlElement(id), picker = document.createElement('input');
    this.name(id, choose, files);
    picker.setAttribute('aria-label', folder);
    const add = files => box.$refs.qRef.addFiles([...files].filter(f => !f.name.startsWith('.')));
    const all = async reader => {
      const found = [];
      for (;;) {
        const some = await new Promise((yes, no) => reader.readEntries(yes, no));
        if (!some.length) return found;
        found.push(...some);
      }
    };
    const walk = async entry => entry.isFile
      ? [await new Promise((yes, no) => entry.file(yes, no))]
      : (await Promise.all((await all(entry.createReader())).map(walk))).flat();
    picker.type = 'file'; picker.webkitdirectory = true; picker.style.display = 'none'; root.after(picker);
    picker.onchange = () => { add(picker.files); picker.value = ''; };
    document.getElementById('choose-folder').onclick = () => picker.click();
    root.addEventListener('drop', async event => {
      const entries = [...event.dataTransfer.items].map(i => i.webkitGetAsEntry?.()).filter(Boolean);
      if (!entries.some(entry => entry.isDirectory)) return;
      event.preventDefault(); event.stopImmediatePropagation();
      add((await Promise.all(entries.map(walk))).flat());
    }, true);
  },
};
document.addEventListener('change', event => {  // the page is built anew in the language that was chosen
  if (event.target.id !== 'language') return;
  document.cookie = `vibrident-language=${event.target.value}; path=/; max-age=31536000; samesite=lax`;
  location.reload();
});
let listing;
const contents = () => {  // a link to each step that is there, once there is more than one
  const bar = document.getElementById('contents');
  const seen = [...document.querySelectorAll('.step')].filter(step => step.offsetParent);
  const words = step => step.querySelector('h2').lastChild.textContent;
  const key = seen.map(step => step.id).join();
  if (!bar || bar.dataset.key === key) return;
  bar.dataset.key = key;
  bar.hidden = seen.length < 3;
  bar.replaceChildren(...seen.map(step => Object.assign(document.createElement('a'), {
    href: '#' + step.id, textContent: words(step),
    onclick(event) { event.preventDefault(); vibrident.go(step.id); },
  })));
};
addEventListener('DOMContentLoaded', () => new MutationObserver(() => {
  clearTimeout(listing); listing = setTimeout(contents, 100);
}).observe(document.body, { childList: true, subtree: true, attributes: true, attributeFilter: ['class'] }));
let resizing;
addEventListener('resize', () => { clearTimeout(resizing); resizing = setTimeout(() => vibrident.fit(), 150); });
