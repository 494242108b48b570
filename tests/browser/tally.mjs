// What was looked at and what of it failed; a failure is told at once.
export const failures = [];
export let count = 0;

export function holds(what, is) {
  count += 1;
  if (is) return;
  failures.push(what);
  console.log(`FAIL ${what}`);
}

// What may fail by never coming about.
export async function step(what, act) {
  try {
    await act();
    count += 1;
  } catch (error) {
    failures.push(what);
    console.log(`FAIL ${what}: ${error.message}`);
  }
}
