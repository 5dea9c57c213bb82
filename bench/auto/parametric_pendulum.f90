! The pendulum on a crank of models/parametric_pendulum.hpp, (M1) and (M2), for AUTO-07p: autonomous through an
! oscillator whose cycle is the forcing, u(3) = sin(omega t), u(4) = cos(omega t), and in a frame that turns with the
! locked rotation, phi = u(1) - omega t, so that all variables are periodic.
!
! par(1) = omega; the other parameters have the model's defaults.
subroutine func(ndim, u, icp, par, ijac, f, dfdu, dfdp)
  implicit none
  integer, intent(in) :: ndim, ijac, icp(*)
  double precision, intent(in) :: u(ndim), par(*)
  double precision, intent(out) :: f(ndim), dfdu(ndim, *), dfdp(ndim, *)
  double precision, parameter :: m = 0.0858d0, l = 0.317d0, k2 = 4.85d-4, k3 = 1.90d-4, g = 9.81d0, a = 0.131d0
  double precision, parameter :: e = 0.173d0, inertia = m * l * l
  double precision :: omega, s, c, r, v, root, rod, p
  omega = par(1)
  v = u(2)
  s = u(3)
  c = u(4)
  r = 1d0 - s * s - c * c
  root = 1d0 - e * e * s * s
  rod = e * (1d0 - 2d0 * s * s + e * e * s**4) / (root * sqrt(root))
  p = g / l - a * omega * omega / l * (c + rod)
  f(1) = v + omega
  f(2) = -(k2 * v + k3 * v * abs(v)) / inertia - p * (sin(u(1)) * c - cos(u(1)) * s)
  f(3) = omega * c + s * r
  f(4) = -omega * s + c * r
end subroutine func

subroutine stpnt(ndim, u, par, t)
  implicit none
  integer, intent(in) :: ndim
  double precision, intent(inout) :: u(ndim), par(*)
  double precision, intent(in) :: t
  par(1) = 13d0
end subroutine stpnt

subroutine bcnd
end subroutine bcnd

subroutine icnd
end subroutine icnd

subroutine fopt
end subroutine fopt

subroutine pvls
end subroutine pvls
