"""Newton's method of `pushgraph.network.body_problem`, of one scene."""

import math

import numpy as np

from pushgraph.network import body_problem
from pushgraph.network.compiled.jit import compiled

ITERATIONS, TOLERANCE, SHARES, TINY = (
    body_problem.ITERATIONS,
    body_problem.TOLERANCE,
    body_problem.SHARES,
    body_problem.TINY,
)


@compiled
def solve(mass, inertia, free, guess, count, contacts, velocity):
    """Write the velocity of least energy; contacts: see `compiled.body_step.Contacts`."""
    if count == 0:
        velocity[:] = free
        return
    velocity[:] = guess
    matrix, gradient, tried, slope = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty((3, 3))
    for _ in range(ITERATIONS):
        _linearize(mass, inertia, free, count, contacts, velocity, matrix, gradient, slope)
        _solve_positive(matrix, gradient)
        least, best, change = math.inf, 0.0, 0.0
        for share in SHARES:
            for row in range(6):
                tried[row] = velocity[row] - share * gradient[row]
            energy = _energy(mass, inertia, free, count, contacts, tried)
            if energy < least:
                least, best = energy, share
        for row in range(6):
            velocity[row] -= best * gradient[row]
            change = max(change, abs(gradient[row]))
        if change <= TOLERANCE:
            break


@compiled
def _stretch(contacts, k, velocity):
    """(w m - d) / R, of which along m and the rest, and the rest's length."""
    arm, aim, normal = contacts.arm[k], contacts.aim[k], contacts.normal[k]
    x = (aim[0] - velocity[0] - velocity[4] * arm[2] + velocity[5] * arm[1]) / contacts.softness[k]
    y = (aim[1] - velocity[1] - velocity[5] * arm[0] + velocity[3] * arm[2]) / contacts.softness[k]
    z = (aim[2] - velocity[2] - velocity[3] * arm[1] + velocity[4] * arm[0]) / contacts.softness[k]
    along = -(x * normal[0] + y * normal[1] + z * normal[2])
    x, y, z = x + along * normal[0], y + along * normal[1], z + along * normal[2]
    return along, x, y, z, math.sqrt(x * x + y * y + z * z)


@compiled
def _energy(mass, inertia, free, count, contacts, velocity):
    total = 0.0
    for i in range(3):
        total += mass * (velocity[i] - free[i]) ** 2
        for k in range(3):
            total += (velocity[3 + i] - free[3 + i]) * inertia[i, k] * (velocity[3 + k] - free[3 + k])
    for k in range(count):
        friction = contacts.friction[k]
        along, _, _, _, length = _stretch(contacts, k, velocity)
        if length <= friction * along:
            total += contacts.softness[k] * (along * along + length * length)
        else:
            # The impulse on the cone: sliding times (push + friction across).
            sliding = max(along + friction * length, 0.0)
            total += contacts.softness[k] * sliding * sliding / (1 + friction * friction)
    return total / 2


@compiled
def _linearize(mass, inertia, free, count, contacts, velocity, matrix, gradient, slope):
    """Curvature, its lower triangle, and gradient of the energy."""
    matrix[:] = 0.0
    for i in range(3):
        matrix[i, i] = mass
        gradient[i] = mass * (velocity[i] - free[i])
        gradient[3 + i] = 0.0
        for k in range(3):
            matrix[3 + i, 3 + k] = inertia[i, k]
            gradient[3 + i] += inertia[i, k] * (velocity[3 + k] - free[3 + k])
    impulse = np.empty(3)
    for k in range(count):
        if not _project(contacts, k, velocity, impulse, slope):
            continue
        arm = contacts.arm[k]
        gradient[0] -= impulse[0]
        gradient[1] -= impulse[1]
        gradient[2] -= impulse[2]
        gradient[3] -= arm[1] * impulse[2] - arm[2] * impulse[1]
        gradient[4] -= arm[2] * impulse[0] - arm[0] * impulse[2]
        gradient[5] -= arm[0] * impulse[1] - arm[1] * impulse[0]
        # J = (1, -[arm]): J' S J has the blocks S, [arm] S and [arm] S [arm]'.
        for column in range(3):
            x, y, z = slope[0, column], slope[1, column], slope[2, column]
            matrix[column, column] += slope[column, column]
            for row in range(column):
                matrix[column, row] += slope[column, row]
            matrix[3, column] += arm[1] * z - arm[2] * y
            matrix[4, column] += arm[2] * x - arm[0] * z
            matrix[5, column] += arm[0] * y - arm[1] * x
        for row in range(3):
            # A row of [arm] S, S being symmetric; then that times [arm]'.
            one, two = (row + 1) % 3, (row + 2) % 3
            x = arm[one] * slope[two, 0] - arm[two] * slope[one, 0]
            y = arm[one] * slope[two, 1] - arm[two] * slope[one, 1]
            z = arm[one] * slope[two, 2] - arm[two] * slope[one, 2]
            matrix[3 + row, 3] += arm[1] * z - arm[2] * y
            matrix[3 + row, 4] += arm[2] * x - arm[0] * z
            matrix[3 + row, 5] += arm[0] * y - arm[1] * x


@compiled
def _project(contacts, k, velocity, impulse, slope):
    """Impulse of a contact, and its derivative over the softness; False where both are zero."""
    friction, normal = contacts.friction[k], contacts.normal[k]
    along, x, y, z, length = _stretch(contacts, k, velocity)
    if length <= friction * along:
        impulse[0], impulse[1], impulse[2] = x - along * normal[0], y - along * normal[1], z - along * normal[2]
        slope[:] = 0.0
        slope[0, 0] = slope[1, 1] = slope[2, 2] = 1 / contacts.softness[k]
        return True
    sliding = (along + friction * length) / (1 + friction * friction)
    if sliding <= 0:
        return False
    way, ray = np.empty(3), np.empty(3)
    span = max(length, TINY)
    way[0], way[1], way[2] = x / span, y / span, z / span
    turning = friction * sliding / span
    for i in range(3):
        ray[i] = friction * way[i] - normal[i]
        impulse[i] = sliding * ray[i]
    for i in range(3):
        for j in range(3):
            sideways = (1.0 if i == j else 0.0) - normal[i] * normal[j] - way[i] * way[j]
            value = ray[i] * ray[j] / (1 + friction * friction) + turning * sideways
            slope[i, j] = value / contacts.softness[k]
    return True


@compiled
def _solve_positive(matrix, right):
    """Solve a positive definite system in place, by Cholesky's factors; the lower triangle is read."""
    for column in range(6):
        pivot = matrix[column, column]
        for k in range(column):
            pivot -= matrix[column, k] * matrix[column, k]
        pivot = math.sqrt(pivot)
        matrix[column, column] = pivot
        for row in range(column + 1, 6):
            value = matrix[row, column]
            for k in range(column):
                value -= matrix[row, k] * matrix[column, k]
            matrix[row, column] = value / pivot
    for row in range(6):
        value = right[row]
        for k in range(row):
            value -= matrix[row, k] * right[k]
        right[row] = value / matrix[row, row]
    for row in range(5, -1, -1):
        value = right[row]
        for k in range(row + 1, 6):
            value -= matrix[k, row] * right[k]
        right[row] = value / matrix[row, row]
