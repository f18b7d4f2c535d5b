// Two jobs side by side: one control plays both videos, and moves both robots on the plan, by simulated time.

// Seconds that a video may be away from the control's time before it is set right: less stutters, more is seen.
const MOST_DRIFT_S = 0.2;

// The place on a path at a time, which stays at its ends.
function placeOnWay(way, time_s) {
  const { times, places } = way;
  if (time_s <= times[0]) return places[0];
  const next = times.findIndex((each) => each > time_s);
  if (next < 0) return places[places.length - 1];
  const share = (time_s - times[next - 1]) / (times[next] - times[next - 1]);
  return places[next].map((value, axis) => places[next - 1][axis] + share * (value - places[next - 1][axis]));
}

function readWay(line, card) {
  const side = Array.from(line.classList).find((each) => each.startsWith("side-"));
  return {
    times: line.dataset.times.split(" ").map(Number),
    places: line.getAttribute("points").split(" ").map((pair) => pair.split(",").map(Number)),
    robot: card.querySelector(`.robot.${side}`),
  };
}

function besideEachOther(card) {
  const player = card.querySelector(".player");
  const [play, bar, told, speed] = ["button", "input", "output", "select"].map((each) => player.querySelector(each));
  const end_s = Number(card.dataset.end);
  const ways = Array.from(card.querySelectorAll(".way[data-times]"), (line) => readWay(line, card));
  const films = Array.from(card.querySelectorAll("video[data-begins]"), (video) => ({ video, begins_s: Number(video.dataset.begins) }));
  let now_s = 0;
  let isPlaying = false;
  let last_ms = null;

  const lengthOf = (film) => (Number.isFinite(film.video.duration) ? film.video.duration : 0);
  const isDead = (film) => film.video.error !== null;
  const isInside = (film) => now_s >= film.begins_s && now_s < film.begins_s + lengthOf(film);
  // A video that loads, or looks for a place, holds the other one up.
  const isWaiting = (film) => !isDead(film) && isInside(film) && (film.video.seeking || film.video.readyState < 3);

  function show() {
    bar.value = now_s;
    told.textContent = `${now_s.toFixed(1)} of ${end_s.toFixed(1)} s`;
    bar.setAttribute("aria-valuetext", `${now_s.toFixed(1)} of ${end_s.toFixed(1)} seconds`);
    for (const way of ways) {
      const [x, y] = placeOnWay(way, now_s);
      way.robot.setAttribute("transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
      way.robot.setAttribute("visibility", now_s > 0 || isPlaying ? "visible" : "hidden");
    }
  }

  function setFilms(isExact) {
    for (const film of films) {
      const { video } = film;
      if (isDead(film) || !lengthOf(film)) continue;
      const wanted_s = Math.min(Math.max(now_s - film.begins_s, 0), lengthOf(film));
      const most_s = isExact || !isInside(film) ? 0.01 : MOST_DRIFT_S * Math.max(1, video.playbackRate);
      if (!video.seeking && Math.abs(video.currentTime - wanted_s) > most_s) video.currentTime = wanted_s;
      const moves = isPlaying && isInside(film) && !films.some(isWaiting);
      if (moves && video.paused) video.play().catch(() => {});
      if (!moves && !video.paused) video.pause();
    }
  }

  function step(at_ms) {
    if (!isPlaying) return;
    const passed_s = last_ms === null ? 0 : (at_ms - last_ms) / 1000;
    last_ms = at_ms;
    // A tab that was not looked at does not jump ahead.
    if (!films.some(isWaiting)) now_s = Math.min(end_s, now_s + Math.min(passed_s, 0.25) * Number(speed.value));
    if (now_s >= end_s) set(false);
    setFilms(false);
    show();
    if (isPlaying) requestAnimationFrame(step);
  }

  function set(playing) {
    isPlaying = playing;
    last_ms = null;
    play.textContent = playing ? "Pause" : "Play";
    play.setAttribute("aria-pressed", String(playing));
  }

  play.addEventListener("click", () => {
    if (!isPlaying && now_s >= end_s) now_s = 0;
    set(!isPlaying);
    setFilms(true);
    show();
    if (isPlaying) requestAnimationFrame(step);
  });
  bar.addEventListener("input", () => {
    now_s = Math.min(end_s, Number(bar.value));
    setFilms(true);
    show();
  });
  // One step of a key is a fiftieth of the whole, whatever the browser's own would be.
  bar.addEventListener("keydown", (event) => {
    const sign = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 5, PageDown: -5 }[event.key];
    if (!sign) return;
    event.preventDefault();
    now_s = Math.min(end_s, Math.max(0, now_s + (sign * end_s) / 50));
    setFilms(true);
    show();
  });
  const setSpeed = () => films.forEach((film) => { film.video.playbackRate = Number(speed.value); });
  speed.addEventListener("change", setSpeed);
  for (const film of films) {
    film.video.controls = false;
    film.video.muted = true;
    film.video.addEventListener("loadedmetadata", () => { setFilms(true); });
    for (const moved of ["seeked", "canplay"]) film.video.addEventListener(moved, () => setFilms(false));
  }
  player.hidden = false;
  show();
}

for (const video of document.querySelectorAll(".beside video")) {
  const tellDead = () => {
    video.hidden = true;
    video.parentElement.querySelector(".note").hidden = false;
  };
  video.addEventListener("error", tellDead);
  if (video.error !== null) tellDead();
}
for (const card of document.querySelectorAll(".beside")) {
  if (card.querySelector(".player")) besideEachOther(card);
}
