"use strict";
(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const plots = [...document.querySelectorAll(".plot")];
  // Without a pointer that hovers the tools would stay over legends.
  const hovers = window.matchMedia("(hover: hover)").matches;
  const config = { responsive: true, displaylogo: false, displayModeBar: hovers ? "hover" : false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "toImage", "sendDataToCloud"] };
  let chosen = null;  // rows that are highlighted, or null

  // The library takes a second to run: after the page has been seen, or when it is needed at once.
  function library() {
    if (window.Plotly) return;
    const script = document.createElement("script");
    script.textContent = document.getElementById("library").textContent;
    document.head.append(script);
  }

  function draw(plot) {
    if (plot.dataset.drawn) return;
    plot.dataset.drawn = "yes";
    library();
    const figure = data.figures[plot.dataset.figure];
    for (const trace of figure.data)
      if (trace.meta === "rows") trace.text = trace.text.map((text, i) => `${data.rows[trace.customdata[i]]}<br>${text}`);
    const font = getComputedStyle(document.body).fontFamily;
    const layout = { ...figure.layout, autosize: true, font: { family: font, size: 13 } };
    plot.replaceChildren();  // of the still picture
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
    for (const button of document.querySelectorAll("[data-group]")) {
      const on = Boolean(rows) && button.dataset.group === key;
      button.setAttribute("aria-pressed", String(on));
      button.textContent = on ? "show all readings again" : "highlight its readings";
    }
    for (const plot of plots) if (plot.dataset.drawn) show(plot); else draw(plot);
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

  const isStill = (plot) => plot.querySelector(".still") !== null;
  const inSpace = (plot) => plot.closest(".wide") !== null;
  const inView = (plot) => {
    const box = plot.getBoundingClientRect();
    return box.bottom > 0 && box.top < window.innerHeight;
  };
  for (const plot of plots.filter(isStill)) plot.addEventListener("pointerenter", () => draw(plot), { once: true });
  window.addEventListener("beforeprint", () => plots.filter((plot) => !isStill(plot)).forEach(draw));

  // One by one, so that the page answers in between: what is in view first, what is in space last.
  function next() {
    const left = plots.filter((plot) => !plot.dataset.drawn && !isStill(plot));
    const plot = left.find(inView) || left.find((one) => !inSpace(one)) || left[0];
    if (plot) { draw(plot); setTimeout(next, 0); } else document.body.dataset.ready = "yes";
  }
  requestAnimationFrame(() => setTimeout(() => { if (plots.length) library(); setTimeout(next, 0); }, 0));
})();
