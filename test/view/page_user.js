"use strict";
// Works the controls of the page as a user does and notes what is shown, as JSON in #found.
// test_page.py puts it after the page's own script, and `complaints` before it.

const found = {complaints};
const id = (name) => document.getElementById(name);
const all = (selector, read) => Array.from(document.querySelectorAll(selector), read);
const clock = () => id("clock").textContent;

// ---- what is shown --------------------------------------------------------------------------

const copy = document.createElement("canvas").getContext("2d", {willReadFrequently: true});

/** Red, green, blue and alpha of every pixel of the 3D view. */
function pixels() {
  const {width, height} = id("view");
  copy.canvas.width = width;
  copy.canvas.height = height;
  copy.drawImage(id("view"), 0, 0);
  return copy.getImageData(0, 0, width, height).data;
}

/** A number that differs from picture to picture. */
function picture() {
  return pixels().reduce((sum, v, k) => (sum + v * (k % 251 + 1)) % 1000000007, 0);
}

/** Number of pixels with a vivid colour. */
function vivid() {
  const data = pixels();
  let count = 0;
  for (let k = 0; k < data.length; k += 4) {
    const rgb = [data[k], data[k + 1], data[k + 2]];
    count += Math.max(...rgb) - Math.min(...rgb) > 60;
  }
  return count;
}

/** Title of a plot, and the number of points of each of its lines. */
function linesOf(svg) {
  const lines = Array.from(svg.querySelectorAll("polyline"), (line) => line.getAttribute("points"));
  return [svg.querySelector("text").textContent, ...lines.map((line) => line.split(" ").length)];
}

// ---- what a user does -----------------------------------------------------------------------

function press(key) {
  document.dispatchEvent(new KeyboardEvent("keydown", {key}));
}

function send(element, event) {
  element.dispatchEvent(event);
}

function choose(color) {
  id("color").value = color;
  send(id("color"), new Event("change"));
}

function slide(time) {
  id("scrub").value = time;
  send(id("scrub"), new Event("input"));
}

found.pictures = {opened: picture()};

/** Do something, and keep the picture and the clock after it. */
function look(name, action) {
  action();
  found.pictures[name] = picture();
  found[name] = clock();
}

found.vivid = vivid();
found.range = [Number(id("scrub").min), Number(id("scrub").max)];
found.colors = all("#color option", (option) => option.textContent);
found.legends = found.colors.map((_, k) => {
  choose(k);
  return id("legend").hidden ? null : [id("low").textContent, id("high").textContent];
});
choose(0);
for (const n of [1, 2, 3]) press("ArrowRight");
look("three", () => {});
look("back", () => press("ArrowLeft"));
look("end", () => press("End"));
look("points", () => id("points").click());
look("one colour", () => choose(found.colors.length - 1));
const drag = {buttons: 1, movementX: 40, movementY: 9};
look("turned", () => send(id("view"), new PointerEvent("pointermove", drag)));
look("zoomed", () => send(id("view"), new WheelEvent("wheel", {deltaY: -300, cancelable: true})));
look("reset", () => id("home").click());
look("home", () => press("Home"));

const frames = new Set();
found.slid = [0.1, 0.2, 0.3].map((time) => {
  slide(time);
  frames.add(picture());
  return [clock(), ...new Set(all("#plots .now", (line) => line.getAttribute("transform")))];
});
found.frames = frames.size;

found.plots = all("#plots svg", linesOf);
const plot = document.querySelector("#plots svg"), edge = plot.getBoundingClientRect();
send(plot, new MouseEvent("click", {clientX: edge.left + 0.6 * edge.width}));
found.clicked = clock();
const shown = all("h1, .row, .hint, #plots", (element) => element.outerHTML).join();
found.faulty = shown.match(/NaN|undefined|Infinity/);

id("speed").value = 2;
press("Home");
press(" ");
found.playing = id("play").textContent;
setTimeout(() => {
  found.played = [clock(), id("play").textContent];
  id("found").textContent = JSON.stringify(found);
}, 1500);
