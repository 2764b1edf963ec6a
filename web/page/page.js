// The page: chooses a log, starts a worker that maps it, and shows what comes from there.

import { View } from "./view.js";

const $ = (id) => document.getElementById(id);
const view = new View($("canvas"), (moved) => { $("fit").hidden = !moved; });
let worker = null;

// Maps a file, or without one the demo.
function start(file) {
  stop();
  for (const id of ["result", "error", "empty", "fit"]) $(id).hidden = true;
  for (const id of ["run", "legend", "stop", "bar"]) $(id).hidden = false;
  $("legend").classList.add("is-live");
  $("name").textContent = file ? file.name : "Demo building";
  showNumbers([]);
  showProgress("Starting", undefined);
  view.clear();
  worker = new Worker("worker.js", { type: "module" });
  worker.onmessage = ({ data }) => handle[data.kind](data);
  worker.onerror = (event) => handle.error({ text: event.message || "The page could not load its program: is it opened through a server?" });
  worker.postMessage({
    file,
    maps: $("maps").valueAsNumber,
    seed: $("seed").valueAsNumber,
    backend: hasGpu ? $("backend").value : "cpu",
    scanTopic: $("scan-topic").value,
    odometryTopic: $("odometry-topic").value,
  });
}

function stop() {
  worker?.terminate();
  worker = null;
  $("stop").hidden = $("bar").hidden = true;
}

const handle = {
  progress: ({ doing, share }) => showProgress(doing, share),

  step: ({ shown, scans, effective }) => {
    view.show(shown);
    showNumbers([
      ["Scans", count(scans)],
      ["Walls", count(shown.walls.length / 4)],
      ["Particles", count(shown.particles.length / 4)],
      ["Effective sample size", effective.toFixed(1)],
    ]);
  },

  finished: ({ shown, summary, files }) => {
    stop();
    view.show(shown);
    $("legend").classList.remove("is-live");
    const speed = summary.seconds / summary.run_seconds;
    $("status").textContent = `Mapped in ${summary.run_seconds.toFixed(1)} s, ${Math.round(speed)} times real time`;
    $("canvas").setAttribute("aria-label", `Map of ${summary.walls} walls with the path of the robot`);
    showNumbers([
      ["Scans", count(summary.scans)],
      ["Walls", count(summary.walls)],
      ["Path", `${summary.metres.toFixed(1)} m`],
      ["Duration", `${summary.seconds.toFixed(0)} s`],
      ["Steps", count(summary.steps)],
      ["Effective sample size", summary.effective_sample_size.toFixed(1)],
      ["Loops closed", count(summary.loops)],
      ["Evaluated on", summary.evaluated_on],
    ]);
    $("verdict").textContent = summary.verdict === "consistent" ? "Consistent" : "Doubtful";
    $("verdict").className = `verdict ${summary.verdict}`;
    list("doubts", summary.doubts);
    list("warnings", summary.warnings);
    $("warnings-box").hidden = summary.warnings.length === 0;
    $("warnings-title").textContent = summary.warnings.length === 1 ? "1 warning" : `${summary.warnings.length} warnings`;
    offer(files);
    $("result").hidden = false;
  },

  error: ({ text }) => {
    stop();
    $("status").textContent = "Nothing was mapped.";
    $("error").textContent = text;
    $("error").hidden = false;
    showEmpty();
  },
};

// Where there is no map, what can be done.
function showEmpty() {
  $("empty").hidden = view.shown !== null;
  $("legend").hidden = view.shown === null;
}

function showProgress(doing, share) {
  $("status").textContent = share === undefined ? `${doing}…` : `${doing}: ${Math.round(100 * share)} %`;
  if (share === undefined) $("bar").removeAttribute("value"); else $("bar").value = share;
}

function showNumbers(rows) {
  $("numbers").replaceChildren(...rows.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
}

function list(id, texts) {
  $(id).replaceChildren(...texts.map((text) => element("li", text)));
}

function offer(files) {
  for (const link of $("files").children) URL.revokeObjectURL(link.href);
  const links = Object.entries(files).map(([name, content]) => {
    const type = { json: "application/json", svg: "image/svg+xml" }[name.split(".").at(-1)] ?? "text/plain";
    return Object.assign(element("a", name), { className: "button", download: name, href: URL.createObjectURL(new Blob([content], { type })) });
  });
  $("files").replaceChildren(...links);
}

function element(tag, text) {
  return Object.assign(document.createElement(tag), { textContent: text });
}

// The program waits for a GPU, so the browser has to be able to suspend it.
const hasGpu = "gpu" in navigator && "Suspending" in WebAssembly;
$("backend").disabled = !hasGpu;
if (!hasGpu) {
  $("backend").value = "cpu";
  $("backend-hint").textContent = "This browser has no WebGPU for the program: the CPU does all.";
}

const count = (number) => number.toLocaleString("en");

$("demo").addEventListener("click", () => start(null));
$("choose").addEventListener("click", () => $("file").click());
$("file").addEventListener("change", () => {
  const [file] = $("file").files;
  // So that the same file can be chosen again.
  $("file").value = "";
  if (file) start(file);
});
$("stop").addEventListener("click", () => {
  stop();
  $("status").textContent = "Stopped.";
  showEmpty();
});
$("fit").addEventListener("click", () => view.fit());

const hasFile = (event) => event.dataTransfer?.types.includes("Files");
addEventListener("dragover", (event) => {
  if (!hasFile(event)) return;
  event.preventDefault();
  document.body.classList.add("is-dragging");
});
addEventListener("dragleave", (event) => {
  // Left for another part of the page.
  if (!event.relatedTarget) document.body.classList.remove("is-dragging");
});
addEventListener("drop", (event) => {
  document.body.classList.remove("is-dragging");
  if (!hasFile(event)) return;
  event.preventDefault();
  const [file] = event.dataTransfer.files;
  if (file) start(file);
});
