"use strict";
(() => {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const config = {
    responsive: true,
    displaylogo: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d"],
    toImageButtonOptions: { format: "svg" },
  };
  const drawn = [];

  // On a touch screen a drag scrolls the page; on a narrow one the labels of the axes give way to the curves.
  const fitted = (figure, place) => {
    const layout = { ...figure.layout };
    if (touch) layout.dragmode = false;
    if (place.clientWidth < 520) {
      layout.margin = { ...layout.margin, l: 52, r: 8 };
      layout.font = { ...layout.font, size: 11 };
      delete layout.updatemenus;
      layout.legend = { ...layout.legend, font: { size: 10 } };
    }
    return layout;
  };
  // On a narrow screen the toolbar would lie on the legend.
  const bar = place => ({ ...config, displayModeBar: touch || place.clientWidth < 520 ? false : "hover" });
  const draw = (place, figure) => Plotly.react(place, figure.data, fitted(figure, place), bar(place));

  for (const place of document.querySelectorAll(".plot")) {
    const figure = figures[place.dataset.figure];
    if (Array.isArray(figure)) {
      const select = place.parentElement.querySelector("select");
      select.addEventListener("change", () => draw(place, figure[select.selectedIndex]));
      draw(place, figure[select.selectedIndex]);
    } else {
      draw(place, figure);
    }
    drawn.push(place);
  }

  // Paper is as wide as A4 and shows what is folded away.
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((part) => { part.dataset.was = part.open; part.open = true; });
    drawn.forEach((place) => Plotly.relayout(place, { width: 660 }));
  });
  window.addEventListener("afterprint", () => {
    document.querySelectorAll("details").forEach((part) => { part.open = part.dataset.was === "true"; });
    drawn.forEach((place) => { Plotly.relayout(place, { width: null, autosize: true }); });
  });
})();
