"use strict";
(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const plots = [...document.querySelectorAll(".plot")];
  const config = { responsive: true, displaylogo: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "toImage", "sendDataToCloud"] };
  let chosen = null;  // rows that are highlighted, or null

  function draw(plot) {
    if (plot.dataset.drawn) return;
    plot.dataset.drawn = "yes";
    const figure = data.figures[plot.dataset.figure];
    for (const trace of figure.data)
      if (trace.meta === "rows") trace.text = trace.text.map((text, i) => `${data.rows[trace.customdata[i]]}<br>${text}`);
    const font = getComputedStyle(document.body).fontFamily;
    const layout = { ...figure.layout, autosize: true, font: { family: font, size: 13 } };
    Plotly.newPlot(plot, figure.data, layout, config).then(() => {
      plot.on("plotly_click", (event) => {
        const row = event.points[0] && event.points[0].customdata;
        if (Number.isInteger(row)) highlight(chosen && chosen.size === 1 && chosen.has(row) ? null : new Set([row]));
      });
      if (chosen) show(plot);
    });
  }

  function show(plot) {
    const traces = plot.data || [];
    traces.forEach((trace, index) => {
      if (!trace.customdata || !/markers/.test(trace.mode || "")) return;
      const points = chosen && [...trace.customdata.keys()].filter((i) => chosen.has(trace.customdata[i]));
      Plotly.restyle(plot, { selectedpoints: [points], "unselected.marker.opacity": 0.08 }, [index]);
    });
    plot.dataset.highlighted = chosen ? chosen.size : "";
  }

  function highlight(rows, key) {
    chosen = rows;
    for (const button of document.querySelectorAll("[data-group]"))
      button.setAttribute("aria-pressed", String(Boolean(rows) && button.dataset.group === key));
    plots.filter((plot) => plot.dataset.drawn).forEach(show);
  }

  for (const button of document.querySelectorAll("[data-group]"))
    button.addEventListener("click", () => {
      const key = button.dataset.group;
      if (button.getAttribute("aria-pressed") === "true") highlight(null);
      else highlight(new Set(data.groups[key][0]), key);
    });

  function sort(button) {
    const head = button.closest("th"), table = button.closest("table"), body = table.tBodies[0];
    const column = head.cellIndex, up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const key = (row) => {
      const cell = row.cells[column], value = cell.dataset.value;
      return value === undefined ? cell.textContent : Number(value);
    };
    const order = (a, b) => {
      const [x, y] = [key(a), key(b)];
      if (typeof x === typeof y) return typeof x === "number" ? x - y : x.localeCompare(y, undefined, { numeric: true });
      return typeof x === "number" ? -1 : 1;
    };
    [...body.rows].sort((a, b) => (up ? order(a, b) : order(b, a))).forEach((row) => body.append(row));
  }
  for (const button of document.querySelectorAll("button.sort")) button.addEventListener("click", () => sort(button));

  const all = () => plots.forEach(draw);
  window.addEventListener("beforeprint", all);
  plots.slice(0, 2).forEach(draw);
  const rest = plots.slice(2);
  const next = () => {
    const plot = rest.shift();
    if (plot) { draw(plot); setTimeout(next, 0); } else document.body.dataset.ready = "yes";
  };
  setTimeout(next, 0);
})();
