// SPDX-License-Identifier: Apache-2.0
// The image viewer: two images of a case on top of one another, wiped by pointer, slider or keys.
"use strict";
(() => {
  const source = document.getElementById("viewer-data");
  if (!source) return;
  const { cases, images } = JSON.parse(source.textContent);
  const $ = (id) => document.getElementById(id);
  const label = (select) => select.options[select.selectedIndex].text;
  let dragging = false;

  function wipe(percent) {
    const p = Math.min(100, Math.max(0, percent));
    $("over").style.clipPath = `inset(0 ${100 - p}% 0 0)`;
    $("bar").style.left = `${p}%`;
    $("position").value = p;
  }

  function show() {
    const found = cases.find((c) => c.scene === $("scene").value && c.graph === $("graph").value);
    if (!found) return;
    $("over").src = images[found[$("left").value]];
    $("under").src = images[found[$("right").value]];
    $("name-left").textContent = label($("left"));
    $("name-right").textContent = label($("right"));
    $("caption").textContent = `${found.scene}, ${found.spp} samples per pixel, ${found.graph}: ${found.text}`;
  }

  function graphs() {
    const before = $("graph").value;
    const names = cases.filter((c) => c.scene === $("scene").value).map((c) => c.graph);
    $("graph").replaceChildren(...names.map((n) => new Option(n, n)));
    if (names.includes(before)) $("graph").value = before;
    show();
  }

  function follow(event) {
    const box = $("wipe").getBoundingClientRect();
    wipe((100 * (event.clientX - box.left)) / box.width);
  }

  $("left").value = "noisy";
  $("right").value = "result";
  $("scene").addEventListener("change", graphs);
  for (const id of ["graph", "left", "right"]) $(id).addEventListener("change", show);
  $("position").addEventListener("input", () => wipe(Number($("position").value)));
  $("wipe").addEventListener("pointerdown", (event) => {
    dragging = true;
    if (event.isTrusted) $("wipe").setPointerCapture(event.pointerId);
    follow(event);
  });
  $("wipe").addEventListener("pointermove", (event) => { if (dragging) follow(event); });
  for (const end of ["pointerup", "pointercancel"]) $("wipe").addEventListener(end, () => { dragging = false; });
  const large = cases.find((c) => c.scene.startsWith("Cornell"));
  if (large) $("scene").value = large.scene;
  graphs();
  wipe(50);
})();
