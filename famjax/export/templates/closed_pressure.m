function P = @name@_pressure(L, F)
%@NAME@_PRESSURE  Gauge pressure P [Pa] at which a muscle of length L [m] pulls with F [N].
%   P is NaN if no pressure in the range of the model produces this force. L and F expand as in L + F.
%   P is computed by bisection; finite differences of P are accurate to their step.
%
@HEADING@
%#codegen
low = @LOWEST@ + zeros(size(L + F));
high = @HIGHEST@ + zeros(size(L + F));
unknown = ~(@name@_force(L, @HIGHEST@) >= F) | @name@_force(L, @LOWEST@) > F | F < 0;
for k = 1:60
    P = (low + high) / 2;
    more = @name@_force(L, P) > F;
    high(more) = P(more);
    low(~more) = P(~more);
end
P = (low + high) / 2;
P(unknown) = NaN;
end
