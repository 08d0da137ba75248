// @ts-check
/** A card that is thrown to the right is loved, to the left dismissed. Buttons do the same for everybody else. */

const FAR = 96; // pixels after which it is meant
const TILT = 0.04; // degrees per pixel
const SLOPE = 1.2; // across more than along, or the finger scrolls

/**
 * @param {HTMLElement} card
 * @param {(loved: boolean) => void} thrown
 */
export function swipeable(card, thrown) {
  /** @type {{x: number, y: number, id: number, across: boolean} | null} */
  let grip = null;

  card.addEventListener("pointerdown", ({ clientX, clientY, pointerId, pointerType }) => {
    if (pointerType !== "mouse") grip = { x: clientX, y: clientY, id: pointerId, across: false };
  });
  card.addEventListener("pointermove", (event) => {
    if (!grip || event.pointerId !== grip.id) return;
    const [x, y] = [event.clientX - grip.x, event.clientY - grip.y];
    if (!grip.across) {
      if (Math.hypot(x, y) < 12) return;
      if (Math.abs(x) < SLOPE * Math.abs(y)) return void (grip = null);
      grip.across = true;
      card.setPointerCapture(event.pointerId);
    }
    place(card, x);
  });
  const end = (/** @type {PointerEvent} */ event) => {
    if (!grip || event.pointerId !== grip.id) return;
    const moved = grip.across ? event.clientX - grip.x : 0;
    grip = null;
    place(card, 0);
    if (event.type === "pointerup" && Math.abs(moved) > FAR) thrown(moved > 0);
  };
  card.addEventListener("pointerup", end);
  card.addEventListener("pointercancel", end);
}

/**
 * @param {HTMLElement} card
 * @param {number} x
 */
function place(card, x) {
  card.classList.toggle("dragged", x !== 0);
  card.classList.toggle("towards-love", x > FAR);
  card.classList.toggle("towards-dismissal", x < -FAR);
  card.style.transform = x ? `translateX(${x}px) rotate(${x * TILT}deg)` : "";
}
