"use strict";
/* The page's behaviour: tables decoded once, filters, charts drawn by Vega-Lite, sorting and export. */
const wearscope = (() => {
  const all = "";
  const tables = {};
  const charts = new Map();
  const state = {};
  const settings = JSON.parse(document.getElementById("settings")?.textContent || "{}");
  const labels = settings.labels || {};

  /* ---- tables: columns as JSON, gzipped, in base64 ---- */
  async function decode(element) {
    const packed = Uint8Array.from(atob(element.textContent.trim()), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const { columns } = JSON.parse(await new Response(stream).text());
    const names = Object.keys(columns);
    const read = {};
    for (const name of names) {
      const column = columns[name];
      read[name] = column.codes ? (row) => column.values[column.codes[row]] : (row) => column[row];
    }
    const first = columns[names[0]];
    const length = names.length ? (first.codes || first).length : 0;
    return { names, columns, read, length };
  }

  function rowsOf(table, wanted) {
    const { names, read, length } = tables[table];
    const tests = Object.entries(wanted).filter(([name]) => read[name]).map(([name, value]) => columnTest(table, name, value));
    const rows = [];
    for (let row = 0; row < length; row += 1) {
      if (tests.every((test) => test(row))) {
        rows.push(Object.fromEntries(names.map((name) => [name, read[name](row)])));
      }
    }
    return rows;
  }

  function columnTest(table, name, value) {
    const column = tables[table].columns[name];
    if (column.codes) {
      const code = column.values.findIndex((one) => same(one, value));
      return (row) => column.codes[row] === code;
    }
    const number = Number(value);
    return (row) => column[row] === number;
  }

  const same = (value, wanted) => String(value) === String(wanted);

  function distinct(table, column, wanted) {
    return [...new Set(rowsOf(table, wanted).map((row) => row[column]))];
  }

  /* ---- what a chart is asked for: its own choices, then the page's filters ---- */
  function choiceOf(chart, key) {
    return key in chart.own ? chart.own[key] : (state[key] ?? all);
  }

  function settle(chart) {
    chart.asked = {};
    for (const source of Object.values(chart.definition.sources)) {
      for (const [column, key] of Object.entries(source.by)) {
        let value = key in chart.asked ? chart.asked[key] : choiceOf(chart, key);
        if (value === all && chart.definition.single.includes(key)) {
          const settled = Object.fromEntries(
            Object.entries(source.by).filter(([, other]) => chart.asked[other]).map(([name, other]) => [name, chart.asked[other]]),
          );
          const values = distinct(source.table, column, settled);
          const preferred = chart.definition.first[key];
          value = values.some((one) => same(one, preferred)) ? preferred : (values[0] ?? all);
        }
        chart.asked[key] = value;
      }
    }
  }

  function rowsFor(chart, name) {
    const source = chart.definition.sources[name];
    const wanted = {};
    for (const [column, key] of Object.entries(source.by)) {
      if (chart.asked[key] !== all) wanted[column] = chart.asked[key];
    }
    return rowsOf(source.table, wanted);
  }

  const label = (key, value) => labels[key]?.[value] ?? String(value);

  /* Text of a title such as "⟦factor⟧": the label of what is chosen, of two choices joined by "|". */
  function fill(text, chart) {
    const chosen = (key) => chart.asked[key] ?? choiceOf(chart, key);
    return text.replace(/⟦([\w+]+)(?:\.(\w+))?⟧/g, (_, key, kind) =>
      label(kind ? `${key}.${kind}` : key, key.split("+").map(chosen).join("|")).replace(/["\\]/g, ""),
    );
  }

  /* ---- drawing ---- */
  const palette = [0, 1, 2, 3, 4, 5, 6].map((k) => `var(--c${k})`);
  const config = {
    background: "transparent",
    aria: false,
    font: "system-ui, sans-serif",
    view: { stroke: "var(--line)" },
    axis: {
      labelColor: "var(--soft)", titleColor: "var(--ink)", gridColor: "var(--line)", gridOpacity: 0.7,
      domainColor: "var(--soft)", tickColor: "var(--soft)", labelFontSize: 12, titleFontSize: 12.5,
      titleFontWeight: 500, labelLimit: 220,
    },
    legend: {
      labelColor: "var(--ink)", titleColor: "var(--soft)", orient: "top", labelFontSize: 12.5,
      titleFontSize: 12, titleFontWeight: 500, labelLimit: 260,
    },
    header: { labelColor: "var(--ink)", titleColor: "var(--soft)" },
    title: { color: "var(--ink)" },
    text: { color: "var(--ink)" },
    range: { category: palette },
    rule: { color: "var(--soft)" },
    point: { size: 36, filled: true },
    circle: { size: 34 },
    line: { strokeWidth: 2 },
  };

  async function draw(chart) {
    settle(chart);
    const text = fill(JSON.stringify(chart.definition.spec), chart);
    if (chart.view && text === chart.drawn) {
      for (const name of Object.keys(chart.definition.sources)) chart.view.data(name, rowsFor(chart, name));
      applySignals(chart);
      await chart.view.runAsync();
    } else {
      const spec = JSON.parse(text);
      spec.datasets ??= {};
      for (const name of Object.keys(chart.definition.sources)) spec.datasets[name] = rowsFor(chart, name);
      chart.view?.finalize();
      // By the container's width, which stays: the plot's own depends on the room that the legend takes.
      const room = chart.place.clientWidth;
      config.legend.columns = room < 400 ? 1 : room < 600 ? 2 : room < 900 ? 3 : 6;
      config.legend.layout = { top: { anchor: innerWidth < 640 ? "end" : "start" } };
      const result = await vegaEmbed(chart.place, spec, {
        mode: "vega-lite", renderer: "svg", actions: false, config, tooltip: { theme: "page" },
        logLevel: 1, // errors; a container with rows of a fixed height is no reason for a warning
      });
      chart.view = result.view;
      chart.drawn = text;
      chart.signals = new Set(Object.keys(chart.view.getState({ signals: () => true, data: () => false }).signals));
      applySignals(chart);
      await chart.view.runAsync();
      // Room for the rows that the legend has at this width: each pass knows only what the one before laid out.
      for (let pass = 0; pass < 3; pass += 1) await chart.view.resize().runAsync();
    }
    tellShown(chart);
    if (chart.sheet && !chart.sheet.hidden) fillSheet(chart);
  }

  function applySignals(chart) {
    for (const [key, value] of Object.entries(chart.own)) {
      if (chart.signals.has(key)) chart.view.signal(key, Number.isNaN(Number(value)) ? value : Number(value));
    }
  }

  function tellShown(chart) {
    const shown = chart.definition.single.filter((key) => settings.filters?.some((one) => one.key === key));
    const text = shown.map((key) => label(key, chart.asked[key])).join(" · ");
    const picked = shown.every((key) => state[key] || !document.querySelector(`.filters [name="${key}"]`));
    chart.shown.textContent = !text ? "" : picked ? text : `${text} (choose others at the top)`;
    const empty = Object.keys(chart.definition.sources).every((name) => rowsFor(chart, name).length === 0);
    chart.figure.classList.toggle("empty", empty);
    if (empty) chart.shown.textContent = "Nothing to show for this choice.";
  }

  /* ---- zoom by button, for keys and touch ---- */
  function zoom(chart, factor) {
    for (const name of chart.signals) {
      const field = /^zoom_(?!tuple|translate|zoom|modify|store)(.+)$/.exec(name)?.[1];
      if (!field) continue;
      if (factor === null) {
        chart.view.signal(name, null);
        continue;
      }
      const scale = chart.view.scale(chart.definition.zoom[field] || "x");
      const [low, high] = scale.domain().map(Number);
      const logarithmic = scale.type === "log" && low > 0;
      const [a, b] = logarithmic ? [Math.log(low), Math.log(high)] : [low, high];
      const middle = (a + b) / 2;
      const half = ((b - a) / 2) * factor;
      const ends = [middle - half, middle + half];
      chart.view.signal(name, logarithmic ? ends.map(Math.exp) : ends);
    }
    chart.view.runAsync();
  }

  /* ---- the numbers behind a chart ---- */
  const digits = new Intl.NumberFormat("en", { maximumSignificantDigits: 4 });
  const written = (value) =>
    value === null || value === undefined ? "n/a" : typeof value === "number" ? digits.format(value).replace("-", "−") : String(value);

  function exportRows(chart) {
    return rowsFor(chart, chart.definition.export);
  }

  function fillSheet(chart) {
    const rows = exportRows(chart);
    const names = rows.length ? Object.keys(rows[0]) : [];
    const most = 200;
    const head = names.map((name) => `<th scope="col">${escape(columnTitle(name))}</th>`).join("");
    const body = rows.slice(0, most).map((row) => `<tr>${names.map((name) => `<td>${escape(written(row[name]))}</td>`).join("")}</tr>`).join("");
    const more = rows.length > most ? `first ${most} of ${rows.length} rows, all in the CSV file` : `${rows.length} rows`;
    chart.sheet.innerHTML = `<table><caption><span>${escape(chart.title)}: ${more}</span></caption><thead><tr>${head}</tr></thead><tbody>${body}</tbody></table>`;
    makeSortable(chart.sheet.querySelector("table"));
  }

  const columnTitle = (name) => labels.column?.[name] ?? name.replace(/_/g, " ");
  const escape = (text) => String(text).replace(/[&<>"]/g, (letter) => `&#${letter.charCodeAt(0)};`);

  function save(name, lines) {
    const cell = (value) => (/[",\n]/.test(String(value ?? "")) ? `"${String(value).replace(/"/g, '""')}"` : String(value ?? ""));
    download(`${name}.csv`, "text/csv", `\ufeff${lines.map((line) => line.map(cell).join(",")).join("\r\n")}\r\n`);
  }

  function download(name, type, text) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  /* As drawn, in the page's colours, which a file of its own does not know by name. */
  async function saveDrawing(chart) {
    const look = getComputedStyle(document.documentElement);
    const drawn = await chart.view.toSVG();
    download(`${chart.figure.id}.svg`, "image/svg+xml", drawn.replace(/var\((--\w+)\)/g, (_, name) => look.getPropertyValue(name).trim()));
  }

  /* ---- reading a chart with the arrow keys ---- */
  function readOut(chart, event) {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const rows = exportRows(chart);
    if (!rows.length) return;
    chart.at = Math.min(rows.length - 1, Math.max(0, (chart.at ?? -1) + step));
    const row = rows[chart.at];
    const parts = Object.entries(row).map(([name, value]) => `${columnTitle(name)} ${written(value)}`);
    chart.readout.textContent = `${chart.at + 1} of ${rows.length}: ${parts.join(", ")}`;
  }

  function prepare(figure) {
    const definition = JSON.parse(figure.querySelector("script.definition").textContent);
    const chart = {
      figure, definition, own: {}, asked: {}, title: figure.querySelector("h3")?.textContent ?? figure.id,
      place: figure.querySelector(".view"), shown: figure.querySelector(".shown"),
      sheet: figure.querySelector(".sheet"), readout: figure.querySelector(".readout"),
    };
    charts.set(figure.id, chart);
    for (const control of figure.querySelectorAll("[data-key]")) {
      const take = () => {
        const options = control.dataset.values ? JSON.parse(control.dataset.values) : null;
        chart.own[control.dataset.key] = options ? options[Number(control.value)] : control.value;
        const output = control.parentElement.querySelector("output");
        if (output) output.textContent = JSON.parse(control.dataset.texts)[Number(control.value)];
        if (options) control.setAttribute("aria-valuetext", output.textContent);
      };
      take();
      control.addEventListener("input", () => {
        take();
        draw(chart);
      });
    }
    for (const button of figure.querySelectorAll("[data-zoom]")) {
      const factor = { in: 0.7, out: 1 / 0.7, reset: null }[button.dataset.zoom];
      button.addEventListener("click", () => zoom(chart, factor));
    }
    figure.querySelector(".csv")?.addEventListener("click", () => {
      const rows = exportRows(chart);
      const names = rows.length ? Object.keys(rows[0]) : [];
      save(figure.id, [names, ...rows.map((row) => names.map((name) => row[name]))]);
    });
    figure.querySelector(".drawing")?.addEventListener("click", () => saveDrawing(chart));
    figure.querySelector(".numbers")?.addEventListener("click", (event) => {
      chart.sheet.hidden = !chart.sheet.hidden;
      event.currentTarget.setAttribute("aria-expanded", String(!chart.sheet.hidden));
      if (!chart.sheet.hidden) fillSheet(chart);
    });
    chart.place.addEventListener("keydown", (event) => readOut(chart, event));
  }

  /* ---- tables of the page: sort, filter, export ---- */
  function makeSortable(table) {
    table.querySelectorAll("thead th").forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const falling = head.getAttribute("aria-sort") === "ascending";
        for (const other of table.querySelectorAll("th")) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", falling ? "descending" : "ascending");
        const body = table.tBodies[0];
        const rows = [...body.rows].sort((one, two) => compare(one.cells[column], two.cells[column]));
        body.append(...(falling ? rows.reverse() : rows));
      });
    });
  }

  function sortValue(cell) {
    const text = (cell?.dataset.value ?? cell?.textContent ?? "").trim();
    const number = Number(text.replace("−", "-").replace(/,/g, "").replace("∞", "Infinity"));
    return { text, number: text === "" || text === "n/a" ? NaN : number };
  }

  function compare(first, second) {
    const [a, b] = [sortValue(first), sortValue(second)];
    if (Number.isNaN(a.number) && Number.isNaN(b.number)) return a.text.localeCompare(b.text, "en", { numeric: true });
    if (Number.isNaN(a.number)) return 1;
    return Number.isNaN(b.number) ? -1 : a.number - b.number;
  }

  function prepareTable(holder, place) {
    const table = holder.querySelector("table");
    makeSortable(table);
    const button = document.createElement("button");
    button.type = "button";
    button.className = "csv";
    button.textContent = "CSV";
    button.setAttribute("aria-label", `Save the table as a CSV file${table.caption ? `: ${table.caption.textContent}` : ""}`);
    button.addEventListener("click", () => {
      const rows = [...table.rows].filter((row) => !row.hidden);
      save(`${holder.closest("section")?.id ?? "table"}-${place + 1}`, rows.map((row) => [...row.cells].map((cell) => cell.textContent.trim())));
    });
    holder.before(button);
    button.classList.add("above");
  }

  function filterTables() {
    for (const row of document.querySelectorAll("[data-cell]")) {
      const own = JSON.parse(row.dataset.cell);
      row.hidden = Object.entries(own).some(([key, value]) => state[key] && !same(state[key], value));
    }
  }

  /* ---- the filters' state: in the address, and said where it hides something ---- */
  const filterKeys = (settings.filters || []).map((one) => one.key);

  function tellFilters() {
    const active = filterKeys.filter((key) => state[key]);
    const note = document.querySelector(".filtered");
    if (note) note.hidden = active.length === 0;
    const query = new URLSearchParams(active.map((key) => [key, state[key]])).toString();
    try {
      history.replaceState(null, "", `${location.pathname}${query ? `?${query}` : ""}${location.hash}`);
    } catch { /* a page within another one has no address of its own */ }
  }

  function readFilters() {
    for (const [key, value] of new URLSearchParams(location.search)) {
      const control = document.querySelector(`.filters [name="${CSS.escape(key)}"]`);
      if (control && [...control.options].some((one) => one.value === value)) control.value = value;
    }
  }

  function set(key, value) {
    state[key] = value;
    if (filterKeys.includes(key)) tellFilters();
    const control = document.querySelector(`.filters [name="${key}"]`);
    if (control && control.value !== value) control.value = value;
    filterTables();
    const drawn = [...charts.values()].filter((chart) =>
      Object.values(chart.definition.sources).some((source) => Object.values(source.by).includes(key)));
    return Promise.all(drawn.map(draw));
  }

  function prepareTheme() {
    const button = document.querySelector(".theme");
    const root = document.documentElement;
    const names = ["auto", "light", "dark"];
    const use = (name) => {
      if (name === "auto") delete root.dataset.theme;
      else root.dataset.theme = name;
      button.textContent = { auto: "Theme: as the system", light: "Theme: light", dark: "Theme: dark" }[name];
    };
    let at = 0;
    button.hidden = false;
    use("auto");
    button.addEventListener("click", () => {
      at = (at + 1) % names.length;
      use(names[at]);
    });
  }

  async function start() {
    prepareTheme();
    document.querySelectorAll(".wide").forEach(prepareTable);
    readFilters();
    for (const control of document.querySelectorAll(".filters [name]")) {
      state[control.name] = control.value;
      control.addEventListener("change", () => set(control.name, control.value));
    }
    document.querySelector(".filters .reset")?.addEventListener("click", () => {
      for (const control of document.querySelectorAll(".filters [name]")) set(control.name, all);
    });
    filterTables();
    tellFilters();
    for (const element of document.querySelectorAll("script.data")) {
      tables[element.dataset.name] = await decode(element);
      element.remove();
    }
    document.querySelectorAll("figure.chart").forEach(prepare);
    for (const chart of charts.values()) {
      try {
        await draw(chart);
      } catch (error) {
        chart.shown.textContent = "This chart could not be drawn.";
        console.error(chart.figure.id, error);
      }
    }
    let later;
    let width = innerWidth;
    window.addEventListener("resize", () => {
      clearTimeout(later); // Vega lays a legend out by its former number of rows: once more when it is done
      later = setTimeout(() => {
        for (const chart of charts.values()) {
          if (width !== innerWidth) chart.drawn = null;
          if (chart.drawn) chart.view.resize().runAsync();
          else draw(chart);
        }
        width = innerWidth;
      }, 150);
    });
    document.documentElement.dataset.ready = "yes";
  }

  return {
    ready: start(),
    set,
    charts,
    rows: (id, name) => rowsFor(charts.get(id), name ?? charts.get(id).definition.export),
  };
})();
