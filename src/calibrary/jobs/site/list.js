"use strict";
(() => {
  const FACETS = ["status", "grade", "make", "model", "lens", "uncertainty", "last change"];
  const MOST_CHOICES = 2000;
  const table = document.querySelector("#all-cameras").parentElement.querySelector("table");
  const heads = [...table.tHead.rows[0].cells];
  const titles = heads.map((head) => head.textContent.trim());
  const folded = (text) => text.normalize("NFKD").replace(/\p{M}/gu, "").toLowerCase();
  const rows = [...table.tBodies[0].rows].map((row, order) => {
    const cells = [...row.cells].map((cell) => cell.textContent.trim());
    return { row, order, cells, text: folded(cells.join(" ")), shown: true };
  });

  const made = (name, properties = {}, ...children) => {
    const element = Object.assign(document.createElement(name), properties);
    element.append(...children);
    return element;
  };
  const search = made("input", { type: "search", id: "search", autocomplete: "off", spellcheck: false });
  const choices = FACETS.map((title) => {
    const at = titles.indexOf(title);
    const counts = new Map();
    for (const { cells } of rows) counts.set(cells[at], (counts.get(cells[at]) ?? 0) + 1);
    if (counts.size < 2 || counts.size > MOST_CHOICES) return null;
    const select = made("select", { id: `of-${title.replace(" ", "-")}` }, made("option", { value: "" }, "all"));
    for (const value of [...counts.keys()].sort((a, b) => a.localeCompare(b, "en", { numeric: true }))) {
      select.append(made("option", { value }, `${value} (${counts.get(value)})`));
    }
    return { title, at, select };
  }).filter(Boolean);
  const told = made("p", { className: "told", role: "status" });
  const clear = made("button", { type: "button" }, "Show all");
  const labelled = (title, control) => made("div", {}, made("label", { htmlFor: control.id }, title), control);
  const form = made(
    "form",
    { className: "finder" },
    labelled("search", search),
    ...choices.map(({ title, select }) => labelled(title, select)),
    clear,
  );
  form.setAttribute("role", "search");
  form.addEventListener("submit", (event) => event.preventDefault());
  table.parentElement.before(form, told);

  const show = () => {
    const words = folded(search.value).split(/\s+/).filter(Boolean);
    const chosen = choices.filter(({ select }) => select.value !== "");
    let count = 0;
    for (const item of rows) {
      const fits =
        chosen.every(({ at, select }) => item.cells[at] === select.value) &&
        words.every((word) => item.text.includes(word));
      if (fits !== item.shown) {
        item.row.hidden = !fits;
        item.shown = fits;
      }
      count += fits;
    }
    told.textContent = count === rows.length ? `${count} cameras` : `${count} of ${rows.length} cameras`;
    const state = new URLSearchParams();
    if (search.value) state.set("search", search.value);
    for (const { title, select } of chosen) state.set(title, select.value);
    const hash = state.toString() ? `#?${state}` : "";
    if (location.hash.startsWith("#?") || hash) history.replaceState(null, "", hash || "#");
  };
  const restore = () => {
    if (!location.hash.startsWith("#?")) return;
    const state = new URLSearchParams(location.hash.slice(2));
    search.value = state.get("search") ?? "";
    for (const { title, select } of choices) {
      select.value = state.get(title) ?? "";
      if (select.selectedIndex < 0) select.value = "";
    }
  };
  let waiting = 0;
  const soon = () => {
    cancelAnimationFrame(waiting);
    waiting = requestAnimationFrame(show);
  };
  search.addEventListener("input", soon);
  for (const { select } of choices) select.addEventListener("change", soon);
  clear.addEventListener("click", () => {
    search.value = "";
    for (const { select } of choices) select.value = "";
    show();
    search.focus();
  });

  heads.forEach((head, at) => {
    const button = made("button", { type: "button" }, ...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const compared = ({ cells: a }, { cells: b }) => {
        const [one, other] = [a[at], b[at]];
        if ((one === "–") !== (other === "–")) return one === "–" ? 1 : -1;
        const [x, y] = [Number(one), Number(other)];
        return Number.isNaN(x) || Number.isNaN(y) ? one.localeCompare(other, "en", { numeric: true }) : x - y;
      };
      rows.sort((a, b) => (down ? compared(b, a) : compared(a, b)) || a.order - b.order);
      table.tBodies[0].append(...rows.map(({ row }) => row));
    });
  });
  restore();
  show();
})();
