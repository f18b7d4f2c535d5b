// The time line of a job's page: one moment of simulated time, which the plan, the videos, the log and the margins show.
// A video whose times do not fit stays still: a wrong moment would be worse than none.

const line = document.getElementById("timeline");
const end_s = Number(line.dataset.end);
const slider = document.getElementById("moment");
const said = document.getElementById("moment-text");
const SVG = "http://www.w3.org/2000/svg";
const ROUNDING_S = 1e-6;
const NEAR_S = 0.02; // browsers round the times of videos

let time_s = 0;
let poses = [];
let robot = null;

const cursors = [...line.querySelectorAll(".margin")].map((each) => ({
  cursor: each.querySelector(".cursor"),
  now: each.querySelector(".margin-now"),
  samples: JSON.parse(each.dataset.samples),
}));
const logs = [...document.querySelectorAll("pre.log")].map((box) => ({
  box,
  lines: [...box.querySelectorAll("[data-t]")],
  shown: null,
}));
let films = [];

// The last of some things in the order of their times that is not after a time; none is: -1.
function lastUntil(things, timeOf, until_s) {
  let low = 0;
  let high = things.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (timeOf(things[middle]) <= until_s + ROUNDING_S) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

function setTime(wanted_s, from = null) {
  if (!Number.isFinite(wanted_s)) return;
  time_s = Math.min(Math.max(wanted_s, 0), end_s);
  const text = `${time_s.toFixed(2)} s`;
  slider.value = time_s;
  slider.setAttribute("aria-valuetext", `${text} of ${end_s.toFixed(2)} s`);
  said.textContent = text;
  showPose();
  showMargins();
  for (const log of logs) showLine(log);
  for (const film of films) {
    if (film !== from) seek(film);
    // Of a moment before its begin a video shows nothing: what is seen then is dim.
    const isEarly = time_s < film.begins_s - ROUNDING_S;
    film.video.classList.toggle("outside", isEarly);
    const why = film.video.closest("figure").querySelector(".too-early");
    if (why) why.hidden = !isEarly;
  }
}

function showPose() {
  const pose = poses[Math.max(0, lastUntil(poses, (each) => each[0], time_s))];
  const told = document.getElementById("pose");
  if (!pose) return;
  const [at_s, x, y, yaw] = pose;
  const heading = yaw === null ? "" : `, heading ${((yaw * 180) / Math.PI).toFixed(0)}°`;
  told.textContent = `Robot at x ${x.toFixed(2)} m, y ${y.toFixed(2)} m${heading} (recorded at ${at_s.toFixed(2)} s)`;
  if (!robot) return;
  const { left, top, scale } = line.dataset;
  const turn = yaw === null ? 0 : (-yaw * 180) / Math.PI; // y points down in a drawing
  const place = [(x - Number(left)) * Number(scale), (Number(top) - y) * Number(scale)];
  robot.setAttribute("transform", `translate(${place[0].toFixed(2)} ${place[1].toFixed(2)}) rotate(${turn.toFixed(1)})`);
  robot.classList.toggle("without-heading", yaw === null);
}

function showMargins() {
  for (const { cursor, now, samples } of cursors) {
    const x = (1000 * time_s) / end_s;
    cursor.setAttribute("x1", x);
    cursor.setAttribute("x2", x);
    const found = samples[lastUntil(samples, (each) => each[0], time_s)];
    now.textContent = found ? `${Number(found[1].toPrecision(4))} ${now.dataset.unit}` : "–";
  }
}

function showLine(log) {
  const line = log.lines[lastUntil(log.lines, (each) => Number(each.dataset.t), time_s)] ?? null;
  if (line === log.shown) return;
  log.shown?.removeAttribute("aria-current");
  line?.setAttribute("aria-current", "true");
  log.shown = line;
  if (line) log.box.scrollTop = line.offsetTop - log.box.clientHeight / 2;
}

// Videos

function seek(film) {
  if (!film.video.paused) film.video.pause();
  film.wanted_s = Math.min(Math.max(time_s - film.begins_s, 0), Math.max(0, film.video.duration - NEAR_S));
  film.video.currentTime = film.wanted_s;
}

function follow(film) {
  if (film.video.paused) return;
  setTime(film.begins_s + film.video.currentTime, film);
  requestAnimationFrame(() => follow(film));
}

function take(video) {
  const [begins_s, rate_hz, frames] = ["begins", "rate", "frames"].map((name) => Number(video.dataset[name]));
  if (Math.abs(video.duration - frames / rate_hz) > 2 / rate_hz) {
    tellGap(`${video.getAttribute("aria-label")} does not follow: it is not as long as it was when it was recorded.`);
    return;
  }
  const film = { video, begins_s, wanted_s: null };
  films.push(film);
  setTime(time_s);
  video.addEventListener("play", () => follow(film));
  // Where the visitor has moved the video, the time line follows it.
  video.addEventListener("seeking", () => {
    if (video.paused && Math.abs(video.currentTime - film.wanted_s) > NEAR_S) setTime(begins_s + video.currentTime, film);
  });
}

function tellGap(text) {
  const told = document.createElement("li");
  told.textContent = text;
  document.getElementById("gaps").append(told);
}

// The robot on the plan

function makeRobot() {
  const plan = line.querySelector("svg.plan") ?? document.querySelector("article.job svg.plan");
  if (!plan || !line.dataset.scale) return;
  robot = document.createElementNS(SVG, "g");
  robot.setAttribute("class", "robot-now");
  for (const [name, shape] of [["circle", { r: 15 }], ["path", { d: "M34 0L11 -15L11 15Z" }]]) {
    const part = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(shape)) part.setAttribute(key, value);
    robot.append(part);
  }
  plan.append(robot);
}

async function readPoses() {
  try {
    const answer = await fetch(line.dataset.poses);
    if (!answer.ok) throw new Error(`${answer.status}`);
    const found = await answer.json();
    poses = found.poses;
    for (const each of found.missing) tellGap(each);
  } catch (error) {
    tellGap(`The places of the robot could not be read (${error.message}); reload the page.`);
    return;
  }
  if (poses.length) makeRobot();
  showPose();
}

// Moments that a link names

const timeInAddress = () => Number(/^#t=([0-9.]+)$/.exec(location.hash)?.[1] ?? NaN);

function noteInAddress() {
  history.replaceState(null, "", `#t=${Number(time_s.toFixed(2))}`);
}

slider.addEventListener("input", () => setTime(Number(slider.value)));
slider.addEventListener("change", noteInAddress);
line.addEventListener("click", (event) => {
  const wanted = event.target.closest("button[data-t]")?.dataset.t;
  if (wanted === undefined) return;
  setTime(Number(wanted));
  noteInAddress();
});
addEventListener("hashchange", () => setTime(timeInAddress()));

line.querySelector(".scrub").hidden = false;
for (const video of document.querySelectorAll("video[data-begins]")) {
  if (video.readyState >= 1) take(video);
  else video.addEventListener("loadedmetadata", () => take(video), { once: true });
}
if (Number.isFinite(timeInAddress())) {
  setTime(timeInAddress());
  line.querySelector(".scrub").scrollIntoView();
}
showMargins();
line.dataset.ready = "";
readPoses().then(() => { line.dataset.ready = "poses"; });
