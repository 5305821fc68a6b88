function [force, stiffness, area] = @name@_model_force(L, P)
%@NAME@_MODEL_FORCE  Model force, not clipped, and its slopes, for scalar inputs.
%   Returns [G, dG/dL, dG/dP] in N, N/m, m^2 at an active length L [m] and a gauge pressure P [Pa]. G is
%   negative where the muscle is slack.
%
@HEADING@
%#codegen
lengths = [ ...
@LENGTH_NODES@ ];
pressures = [ ...
@PRESSURE_NODES@ ];
% Force [N], dF/dL [N/m], dF/dP [m2], d2F/dLdP [m] for each pressure at each length.
nodes = reshape([ ...
@NODES@ ], 4, @PRESSURES@, @LENGTHS@);
stops = [@STOP_SHORT@, @STOP_LONG@];
stop_stiffness = @STOP_STIFFNESS@;
stop_onset = @STOP_ONSET@;

held = min(max(L, lengths(1)), lengths(end));
at = min(max(P, pressures(1)), pressures(end));
[i, h, u] = cell_of(lengths, held);
[j, g, v] = cell_of(pressures, at);
value = zeros(1, 2); along = zeros(1, 2); rate = zeros(1, 2); cross = zeros(1, 2);
for k = 1:2
    a = nodes(:, j + k - 1, i);
    b = nodes(:, j + k - 1, i + 1);
    [value(k), along(k)] = cubic(a(1), b(1), a(2), b(2), h, u);
    [rate(k), cross(k)] = cubic(a(3), b(3), a(4), b(4), h, u);
end
[force, area] = cubic(value(1), value(2), rate(1), rate(2), g, v);
[stiffness, mixed] = cubic(along(1), along(2), cross(1), cross(2), g, v);

if L ~= held
    [step, slope] = bent(L - held, @LENGTH_END_0@, @LENGTH_END_1@);
    if ~(stiffness > 0)
        stiffness = 0;
        mixed = 0;
    end
    force = force + stiffness * step;
    area = area + mixed * step;
    stiffness = stiffness * slope;
    mixed = mixed * slope;
end
if P ~= at
    [step, slope] = bent(P - at, @PRESSURE_END_0@, @PRESSURE_END_1@);
    if ~(area > 0)
        area = 0;
        mixed = 0;
    end
    force = force + area * step;
    stiffness = stiffness + mixed * step;
    area = area * slope;
end
way = [stops(1) - L, L - stops(2)];
sides = [-1, 1];
for k = 1:2
    if way(k) > 0
        on = min(way(k), stop_onset);
        force = force + sides(k) * stop_stiffness * (on^2 / (2 * stop_onset) + (way(k) - on));
        stiffness = stiffness + stop_stiffness * on / stop_onset;
    end
end
end

function [k, width, u] = cell_of(nodes, value)
k = 1;
last = numel(nodes);
while last - k > 1
    middle = floor((k + last) / 2);
    if nodes(middle) <= value
        k = middle;
    else
        last = middle;
    end
end
width = nodes(k + 1) - nodes(k);
u = (value - nodes(k)) / width;
end

function [value, slope] = cubic(start, stop, rate, stop_rate, width, u)
rise = stop - start;
p = width * rate;
q = width * stop_rate;
square = 3 * rise - 2 * p - q;
cube = p + q - 2 * rise;
value = start + u * (p + u * (square + u * cube));
slope = (p + u * (2 * square + 3 * u * cube)) / width;
end

function [reached, slope] = bent(step, below, above)
inverse = above;
if step < 0
    inverse = below;
end
reached = step;
slope = 1;
way = inverse * abs(step);
if way > 0.8
    t = (way - 0.8) / 0.2;
    reached = sign(step) * (0.8 + 0.2 * t / (1 + t)) / inverse;
    slope = 1 / (1 + t)^2;
end
end
