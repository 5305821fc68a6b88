function [force, stiffness, area] = @name@_force(L, P)
%@NAME@_FORCE  Force [N], >= 0, at active lengths L [m] and gauge pressures P [Pa].
%   Returns [F, dF/dL, dF/dP]; L and P expand as in L + P. The function works in a MATLAB Function block
%   in Simulink and in code generation; @name@_model_force.m must be in the same folder.
%
@HEADING@
%#codegen
L = L + zeros(size(P));
P = P + zeros(size(L));
force = zeros(size(L));
stiffness = force;
area = force;
slack = @SLACK@;
for k = 1:numel(force)
    [model, along, across] = @name@_model_force(L(k), P(k));
    cut = model;
    slope = 1;
    if model <= 0
        cut = 0;
        slope = 0;
    elseif model < slack
        t = model / slack;
        cut = model * t * (2 - t);
        slope = t * (4 - 3 * t);
    end
    force(k) = cut;
    stiffness(k) = slope * along;
    area(k) = slope * across;
end
end
