function [F, G] = @name@_force(L, P)
%@NAME@_FORCE  Force F [N] at active lengths L [m] and gauge pressures P [Pa].
%   G is the force without clipping: it is negative where the muscle is slack. L and P expand as in L + P.
%   F is NaN outside the range of the model. Lengths above @FARTHEST@ m raise an error.
%
@HEADING@
%#codegen
@NUMBERS@
range = [@SHORTEST@, @LONGEST@, @LOWEST@, @HIGHEST@]; % m, m, Pa, Pa
slack = @SLACK@; % N, below which the force blends to zero

if any(L(:) > @FARTHEST@)
    error('@name@:length', 'L must be in m, and at most @FARTHEST@ m');
end
@STATEMENTS@
G = real(G);
G((L < range(1) | L > range(2)) | (P < range(3) | P > range(4))) = NaN;
u = min(max(G / slack, 0), 1);
F = G .* u .* (2 - u);
end
@ALONE@