! Torque-driven pendulum as a boundary value problem for AUTO-07p (IPS = 7: with Floquet multipliers):
!
!   theta'' = -gamma theta' - sin(theta) + A cos(omega t),   theta(1) - theta(0) = 2 pi k,   p periods of the torque
!
! U = (theta, theta', s), s the share of the orbit. PAR(1..3) = gamma, A, omega; PAR(4) = p, PAR(5) = k; PAR(6) occurs
! nowhere and is the free parameter: every point of the branch is the same orbit. The start is read from start.dat: p
! and k, the number of rows, then rows of (s, theta, theta').
SUBROUTINE FUNC(NDIM,U,ICP,PAR,IJAC,F,DFDU,DFDP)
  IMPLICIT NONE
  INTEGER, INTENT(IN) :: NDIM, ICP(*), IJAC
  DOUBLE PRECISION, INTENT(IN) :: U(NDIM), PAR(*)
  DOUBLE PRECISION, INTENT(OUT) :: F(NDIM)
  DOUBLE PRECISION, INTENT(INOUT) :: DFDU(NDIM,NDIM), DFDP(NDIM,*)
  DOUBLE PRECISION :: T, PHASE
  DOUBLE PRECISION, PARAMETER :: PI = 3.14159265358979323846D0
  PHASE = 2*PI*PAR(4)*U(3)
  T = 2*PI*PAR(4)/PAR(3)
  F(1) = T*U(2)
  F(2) = T*(-PAR(1)*U(2) - SIN(U(1)) + PAR(2)*COS(PHASE))
  F(3) = 1
  IF (IJAC == 0) RETURN
  DFDU = 0
  DFDU(1,2) = T
  DFDU(2,1) = -T*COS(U(1))
  DFDU(2,2) = -T*PAR(1)
  DFDU(2,3) = -T*PAR(2)*SIN(PHASE)*2*PI*PAR(4)
  IF (IJAC == 1) RETURN
  DFDP(:,ICP(1)) = 0
END SUBROUTINE FUNC

SUBROUTINE STPNT(NDIM,U,PAR,T)
  IMPLICIT NONE
  INTEGER, INTENT(IN) :: NDIM
  DOUBLE PRECISION, INTENT(INOUT) :: U(NDIM), PAR(*)
  DOUBLE PRECISION, INTENT(IN) :: T
  INTEGER, SAVE :: ROWS = 0
  DOUBLE PRECISION, ALLOCATABLE, SAVE :: TABLE(:,:)
  DOUBLE PRECISION, SAVE :: PERIODS, TURNS
  DOUBLE PRECISION :: W
  INTEGER :: I
  IF (ROWS == 0) THEN
    OPEN(77, FILE='start.dat', STATUS='OLD')
    READ(77,*) PERIODS, TURNS, ROWS
    ALLOCATE(TABLE(3,ROWS))
    READ(77,*) TABLE
    CLOSE(77)
  END IF
  PAR(1) = 0.2D0
  PAR(2) = 1.2D0
  PAR(3) = 2D0/3D0
  PAR(4) = PERIODS
  PAR(5) = TURNS
  PAR(6) = 0
  I = MIN(INT(T*(ROWS - 1)) + 1, ROWS - 1)
  W = (T - TABLE(1,I))/(TABLE(1,I+1) - TABLE(1,I))
  U(1:2) = (1 - W)*TABLE(2:3,I) + W*TABLE(2:3,I+1)
  U(3) = T
END SUBROUTINE STPNT

SUBROUTINE BCND(NDIM,PAR,ICP,NBC,U0,U1,FB,IJAC,DBC)
  IMPLICIT NONE
  INTEGER, INTENT(IN) :: NDIM, ICP(*), NBC, IJAC
  DOUBLE PRECISION, INTENT(IN) :: PAR(*), U0(NDIM), U1(NDIM)
  DOUBLE PRECISION, INTENT(OUT) :: FB(NBC)
  DOUBLE PRECISION, INTENT(INOUT) :: DBC(NBC,*)
  DOUBLE PRECISION, PARAMETER :: PI = 3.14159265358979323846D0
  FB(1) = U1(1) - U0(1) - 2*PI*PAR(5)
  FB(2) = U1(2) - U0(2)
  FB(3) = U0(3)
  IF (IJAC == 0) RETURN
  DBC(:,1:2*NDIM) = 0
  DBC(1,1) = -1
  DBC(1,NDIM+1) = 1
  DBC(2,2) = -1
  DBC(2,NDIM+2) = 1
  DBC(3,3) = 1
  IF (IJAC == 1) RETURN
  DBC(:,2*NDIM+ICP(1)) = 0
END SUBROUTINE BCND

SUBROUTINE ICND
END SUBROUTINE ICND

SUBROUTINE FOPT
END SUBROUTINE FOPT

! The multipliers with all their digits (AUTO prints six): real and imaginary parts.
SUBROUTINE PVLS(NDIM,U,PAR)
  IMPLICIT NONE
  INTEGER, INTENT(IN) :: NDIM
  DOUBLE PRECISION, INTENT(IN) :: U(NDIM)
  DOUBLE PRECISION, INTENT(INOUT) :: PAR(*)
  DOUBLE PRECISION, EXTERNAL :: GETP
  INTEGER :: I
  OPEN(78, FILE='multipliers.dat', POSITION='APPEND')
  WRITE(78,'(6ES25.16)') (GETP('EIG',I,U), I = 1, 6)
  CLOSE(78)
END SUBROUTINE PVLS
