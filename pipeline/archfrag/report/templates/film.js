for (const box of document.querySelectorAll(".motion")) {
  const [pause, slider] = box.querySelectorAll("input"), speed = box.querySelector("select");
  const moving = () => box.querySelector(".moving").getAnimations({subtree: true});
  const length = all => all[0].effect.getComputedTiming().duration;
  slider.addEventListener("input", () => {
    pause.checked = true;
    const all = moving();
    for (const each of all) each.currentTime = slider.value * length(all) * 0.9999;
  });
  speed.addEventListener("change", () => {
    for (const each of moving()) each.playbackRate = Number(speed.value);
  });
  setInterval(() => {
    const all = moving();
    if (all.length && !pause.checked) slider.value = all[0].currentTime % length(all) / length(all);
  }, 100);
}
