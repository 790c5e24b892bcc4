// Tables that can be sorted by any column, and commands that can be copied. Without this script all is there to read.
(() => {
  const value = (row, column) => row.cells[column].textContent.trim();
  const number = (text) => {
    const found = text.replaceAll(",", "").replace("−", "-").match(/[-+]?\d+(\.\d+)?/);
    return found ? parseFloat(found[0]) : NaN;
  };
  const compare = (a, b, isNumber) => {
    if (!isNumber) return a.localeCompare(b, "en", { numeric: true });
    const [x, y] = [number(a), number(b)];
    if (isNaN(x) || isNaN(y)) return isNaN(x) - isNaN(y);
    return x - y;
  };
  const sort = (table, heading, original) => {
    const column = heading.cellIndex, isNumber = heading.classList.contains("number");
    const order = isNumber ? ["descending", "ascending", null] : ["ascending", "descending", null];
    const next = order[(order.indexOf(heading.getAttribute("aria-sort")) + 1) % 3];
    for (const each of heading.parentElement.cells) each.removeAttribute("aria-sort");
    if (next) heading.setAttribute("aria-sort", next);
    const sign = next === "descending" ? -1 : 1;
    const sorted = next
      ? [...original].sort((a, b) => {
          const [x, y] = [value(a, column), value(b, column)];
          const missing = isNumber && (isNaN(number(x)) || isNaN(number(y)));
          return (missing ? 1 : sign) * compare(x, y, isNumber);
        })
      : original;
    table.classList.toggle("sorted", next !== null);
    table.tBodies[0].replaceChildren(...sorted);
  };
  for (const table of document.querySelectorAll("table")) {
    const original = [...table.tBodies[0].rows];
    for (const heading of table.tHead.rows[0].cells) {
      const button = document.createElement("button");
      button.type = "button";
      button.title = "Sort by this column; the third time in the first order again";
      button.append(...heading.childNodes);
      button.addEventListener("click", () => sort(table, heading, original));
      heading.append(button);
    }
  }
  const select = (code) => getSelection().selectAllChildren(code);
  for (const code of document.querySelectorAll(".gallery code")) {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "copy";
    button.textContent = "Copy";
    button.addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(code.textContent);
        button.textContent = "Copied";
      } catch {
        select(code);
      }
    });
    code.after(button);
  }
})();
