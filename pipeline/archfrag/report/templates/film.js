for (const box of document.querySelectorAll(".motion")) {
  const [pause, slider] = box.querySelectorAll("input"), speed = box.querySelector("select");
  const all = box.querySelector(".moving").getAnimations({subtree: true});
  if (!all.length) continue;
  const length = all[0].effect.getComputedTiming().duration;
  slider.addEventListener("input", () => {
    pause.checked = true;
    for (const each of all) each.currentTime = slider.value * length * 0.9999;
  });
  speed.addEventListener("change", () => {
    for (const each of all) each.playbackRate = Number(speed.value);
  });
  setInterval(() => { if (!pause.checked) slider.value = all[0].currentTime % length / length; }, 100);
}
