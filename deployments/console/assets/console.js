// The console: parts of a page that the server sends while it is shown. Without this script pages are as they were loaded.

const followed = document.body.dataset.follow;
const log = document.getElementById("log");
const MOST_CHARACTERS = 400000;

function replaceParts(parts) {
  for (const [id, html] of Object.entries(parts)) {
    const place = document.getElementById(id);
    if (!place) continue;
    const focused = place.contains(document.activeElement) && document.activeElement.getAttribute("href");
    place.innerHTML = html;
    // What had the focus keeps it.
    if (focused) place.querySelector(`[href="${CSS.escape(focused)}"]`)?.focus();
  }
}

function addToLog(text) {
  const isAtEnd = log.scrollHeight - log.scrollTop - log.clientHeight < 40;
  log.textContent = ((isLogNew ? "" : log.textContent) + text).slice(-MOST_CHARACTERS);
  isLogNew = false;
  if (isAtEnd) log.scrollTop = log.scrollHeight;
}

// A browser opens six connections to a server. Pages that are not looked at keep none; of the windows that are, four keep
// one each, and all others look for a moment in turn.
const PLACES = 4;
const LOOK_MS = 2000;
const BETWEEN_LOOKS_MS = 3000;
let source = null;
let isOver = false;
let isAsking = false;
let isLogNew = false;
let wait_s = 5;
let givePlaceUp = null;

async function follow() {
  if (source || isAsking || isOver || document.hidden) return;
  isAsking = true;
  try {
    // Browsers have no locks where a page comes from elsewhere without HTTPS.
    if (!navigator.locks || (givePlaceUp = await placeOf(0))) openStream();
    else await navigator.locks.request("console-look", look);
  } finally {
    isAsking = false;
  }
  if (!source) setTimeout(follow, BETWEEN_LOOKS_MS);
}

// What gives up the first place that is free; none is: null.
async function placeOf(number) {
  if (number === PLACES) return null;
  const found = await new Promise((found) => {
    navigator.locks.request(`console-place-${number}`, { ifAvailable: true }, (lock) => {
      if (lock) return new Promise((giveUp) => found(giveUp));
      found(null);
    });
  });
  return found ?? placeOf(number + 1);
}

async function look() {
  if (document.hidden || isOver) return;
  openStream();
  await new Promise((over) => setTimeout(over, LOOK_MS));
  leave();
}

function openStream() {
  if (isOver || document.hidden) return leave();
  source = new EventSource(followed);
  const take = (name, act) => source.addEventListener(name, (event) => act(JSON.parse(event.data)));
  // After a break the server begins the log anew.
  source.addEventListener("open", () => { isLogNew = true; wait_s = 5; tellStale(false); });
  source.addEventListener("error", lookAgain);
  take("parts", replaceParts);
  take("tiles", replaceParts);
  take("log", addToLog);
  take("status", (status) => { document.getElementById("status").textContent = status; });
  take("reload", () => location.reload());
  take("end", () => { isOver = true; leave(); });
}

function leave() {
  source?.close();
  source = null;
  givePlaceUp?.();
  givePlaceUp = null;
}

function tellStale(isStale) {
  document.getElementById("stale").hidden = !isStale;
}

// Where the server refuses, browsers do not ask again by themselves.
function lookAgain() {
  tellStale(true);
  if (source?.readyState !== EventSource.CLOSED) return;
  leave();
  setTimeout(follow, wait_s * 1000);
  wait_s = Math.min(wait_s * 2, 300);
}

if (followed) {
  follow();
  document.addEventListener("visibilitychange", () => { if (document.hidden) leave(); else follow(); });
  addEventListener("pagehide", leave);
  addEventListener("pageshow", follow);
}

for (const each of document.querySelectorAll("pre.log")) each.scrollTop = each.scrollHeight;

const MOST_BYTES = 500000;

function tellTooLarge() {
  const told = document.createElement("p");
  told.className = "note";
  told.textContent = `This is too large: the form may have at most ${MOST_BYTES / 1000} KB.`;
  document.getElementById("live").replaceChildren(told);
}

// What was found replaces what was found before, also fields that are being filled in: the cursor stays where it is.
function showFindings(form, html) {
  const { name, selectionStart, selectionEnd } = document.activeElement ?? {};
  document.getElementById("live").innerHTML = html;
  const field = name && document.activeElement?.name !== name ? form.elements[name] : null;
  if (!field?.closest?.("#live")) return;
  field.focus();
  if (selectionStart != null) field.setSelectionRange(selectionStart, selectionEnd);
}

// Forms that are looked at while they are filled in: what the server says of them so far, a moment after the last key.
for (const form of document.querySelectorAll("form[data-live]")) {
  let timer = 0;
  let asked = new AbortController();
  const ask = async () => {
    asked.abort();
    asked = new AbortController();
    try {
      const answer = await fetch(form.dataset.live, { method: "POST", body: new FormData(form), signal: asked.signal });
      if (answer.ok) showFindings(form, await answer.text());
      else if (answer.status === 413) tellTooLarge();
    } catch (error) {
      if (error.name !== "AbortError") throw error;
    }
  };
  form.addEventListener("input", (event) => {
    if (event.target.type === "file") return;
    asked.abort(); // its answer would take back what is typed now
    clearTimeout(timer);
    timer = setTimeout(ask, 600);
  });
  form.querySelector("input[type=file]")?.addEventListener("change", async (event) => {
    const [file] = event.target.files;
    if (!file) return;
    if (file.size > MOST_BYTES) {
      event.target.value = "";
      tellTooLarge();
      return;
    }
    form.elements.text.value = await file.text();
    form.elements.filename.value = file.name;
    event.target.value = "";
    ask();
  });
}

// A problem's line is marked in the text.
addEventListener("click", (event) => {
  const line = Number(event.target.dataset?.line);
  const area = document.getElementById("spec-text");
  if (!line || !area) return;
  event.preventDefault();
  const lines = area.value.split("\n");
  const start = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
  area.focus();
  area.setSelectionRange(start, start + (lines[line - 1] ?? "").length);
  area.scrollTop = (line - 5) * Number.parseFloat(getComputedStyle(area).lineHeight);
});
