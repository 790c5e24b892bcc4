// What a person takes along from an answer: a text to copy, <button data-ltvn-copy-text="…">, and a file that was just
// written, <button data-ltvn-download="/saved/17.bin" data-name="moment.rrd">, which is fetched with the token.

const SAID_FOR_MS = 2000;

function listenToTakeAlong() {
  document.addEventListener("click", ({ target }) => {
    const button = target instanceof Element ? target.closest("[data-ltvn-copy-text], [data-ltvn-download]") : null;
    if (button === null) return;
    if (button.dataset.ltvnDownload === undefined) copyText(button);
    else downloadFile(button);
  });
}

async function copyText(button) {
  const given = button.dataset.ltvnCopyText;
  // An address within this page is of use elsewhere as a whole, without the token.
  const text = given.startsWith("/") ? addressOf(given) : given;
  try {
    await navigator.clipboard.writeText(text);
    sayOn(button, "copied");
  } catch {
    showToCopy(button, text);
  }
}

// Where the browser lets no script copy, the text stands there, selected.
function showToCopy(button, text) {
  const field = document.createElement("input");
  field.readOnly = true;
  field.value = text;
  field.ariaLabel = "Copy this";
  button.after(field);
  field.focus();
  field.select();
  field.addEventListener("blur", () => field.remove(), { once: true });
}

async function downloadFile(button) {
  try {
    const answer = await fetchWithToken(button.dataset.ltvnDownload);
    if (!answer.ok) return sayOn(button, "it is not there any more");
    const link = document.createElement("a");
    link.href = URL.createObjectURL(await answer.blob());
    link.download = button.dataset.name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), SAID_FOR_MS);
  } catch {
    sayOn(button, "no connection");
  }
}

function sayOn(button, words) {
  const before = button.textContent;
  if (before === words) return;
  button.textContent = words;
  setTimeout(() => (button.textContent = before), SAID_FOR_MS);
}
