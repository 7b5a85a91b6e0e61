// Filters the tables of pushes; without it all rows are shown.
"use strict";
const MOST = matchMedia("(max-width: 720px)").matches ? 8 : 30;
for (const part of document.querySelectorAll(".filtered")) {
  const [words, kind, count, more] = ["input", "select", ".count", "button"].map((name) => part.querySelector(name));
  const heads = [...part.querySelectorAll("thead th")].map((head) => head.textContent);
  const every = [...part.querySelectorAll("tbody tr:not(.group)")];
  for (const row of every) {
    heads.forEach((head, column) => { row.cells[column].dataset.label = head; }); // shown on a phone
  }
  const rows = every.map((row) => ({ row, text: row.textContent.toLowerCase() }));
  let whole = false;
  const show = () => {
    const wanted = words.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = rows.filter(({ row, text }) =>
      (!kind.value || row.className === kind.value) && wanted.every((word) => text.includes(word)));
    const most = whole ? found.length : MOST;
    const shown = new Set(found.slice(0, most));
    for (const entry of rows) entry.row.hidden = !shown.has(entry);
    for (const body of part.querySelectorAll("tbody")) {
      body.rows[0].hidden = ![...body.rows].slice(1).some((row) => !row.hidden);
    }
    more.hidden = found.length <= most;
    count.textContent = `${shown.size} of ${found.length} pushes shown`;
  };
  const again = () => { whole = false; show(); };
  words.addEventListener("input", again);
  kind.addEventListener("change", again);
  more.addEventListener("click", () => { whole = true; show(); });
  part.querySelector(".filter").hidden = false;
  show();
}
