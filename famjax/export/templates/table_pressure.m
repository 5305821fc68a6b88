function pressure = @name@_pressure(L, F)
%@NAME@_PRESSURE  Lowest gauge pressure [Pa] at which a muscle of length L [m] pulls with F [N].
%   The result is 0 if the force at zero pressure is larger, and the limit of @LIMIT@ Pa if the force is
%   never reached. For F <= 0, it is the highest pressure at which the muscle is slack. L and F expand as
%   in L + F; @name@_model_force.m must be in the same folder.
%
@HEADING@
%#codegen
L = L + zeros(size(F));
F = F + zeros(size(L));
pressure = zeros(size(L));
for k = 1:numel(pressure)
    pressure(k) = one(L(k), F(k));
end
end

function pressure = one(L, F)
slack = @SLACK@;
limit = @LIMIT@;
if isnan(L + F)
    pressure = L + F;
    return
end
wanted = max(F, 0);
if F > 0 && F < slack
    t = 1;
    for k = 1:60
        t = min(t - (t^2 * (2 - t) - F / slack) / (t * (4 - 3 * t)), 1);
    end
    wanted = slack * t;
end
low = 0;
high = limit;
if @name@_model_force(L, low) >= wanted
    pressure = low;
    return
end
if @name@_model_force(L, high) <= wanted
    pressure = high;
    return
end
pressure = limit / 2;
before = limit;
for k = 1:60
    [force, ~, area] = @name@_model_force(L, pressure);
    over = force - wanted;
    if over < 0
        low = pressure;
    else
        high = pressure;
    end
    following = (low + high) / 2;
    if 2 * abs(over) <= before * area
        newton = pressure - over / area;
        if low <= newton && newton <= high
            following = newton;
        end
    end
    before = abs(following - pressure);
    pressure = following;
    if before <= 1e-15 * limit
        return
    end
end
end
