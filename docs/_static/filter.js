// A field above each long table that leaves the rows with all of its words.
document.addEventListener("DOMContentLoaded", () => {
  for (const table of document.querySelectorAll("article table")) {
    const rows = [...table.tBodies[0].rows];
    if (rows.length < 30) continue;
    const field = document.createElement("input");
    const count = document.createElement("p");
    field.type = "search";
    field.className = "filter";
    field.placeholder = "words that a row contains";
    field.setAttribute("aria-label", "show the rows that contain these words");
    count.setAttribute("role", "status");
    const texts = rows.map((row) => row.textContent.toLowerCase());
    const show = () => {
      const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
      let shown = 0;
      rows.forEach((row, n) => {
        row.hidden = !words.every((word) => texts[n].includes(word));
        shown += row.hidden ? 0 : 1;
      });
      count.textContent = `${shown} of ${rows.length} rows`;
    };
    field.addEventListener("input", show);
    const box = table.closest(".table-wrapper") || table;
    box.before(field, count);
    show();
  }
});

// What the theme leaves out for those who use a keyboard or hear the page: a heading's level, and boxes that scroll.
document.addEventListener("DOMContentLoaded", () => {
  for (const caption of document.querySelectorAll("p.caption[role=heading]")) caption.setAttribute("aria-level", "2");
  for (const box of document.querySelectorAll(".highlight pre, .table-wrapper")) box.tabIndex = 0;
});
